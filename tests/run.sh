#!/usr/bin/env bash
# Installs what is missing (Debian, Ubuntu), then runs all tests. Real models: VOXSIGHT_MODELS, default ../shared/models.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

if ! command -v cargo >/dev/null; then
    echo "cargo is missing: install Rust 1.95 or newer from https://rustup.rs, then run this again" >&2
    exit 1
fi
# A C++ compiler, for meshoptimizer.
if ! command -v c++ >/dev/null; then
    if ! command -v apt-get >/dev/null; then
        echo "a C++ compiler is missing: install one (g++ or clang++), then run this again" >&2
        exit 1
    fi
    as_root=""
    if [ "$(id -u)" -ne 0 ]; then as_root="sudo"; fi
    $as_root apt-get update
    $as_root apt-get install -y --no-install-recommends g++
fi

cargo test --workspace --locked "$@"
# A library user does without the command line.
cargo check --locked --no-default-features --lib
