#!/usr/bin/env bash
# Installs what is missing (Debian, Ubuntu), then runs all tests. Real models: VOXSIGHT_MODELS, default ../shared/models.
# REQUIRE_GPU=1: fail where no graphics driver works, not even a software one; without it GPU tests say that they skip.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

if ! command -v cargo >/dev/null; then
    echo "cargo is missing: install Rust 1.95 or newer from https://rustup.rs, then run this again" >&2
    exit 1
fi

missing=()
# A C++ compiler, for meshoptimizer.
if ! command -v c++ >/dev/null; then missing+=(g++); fi
# A Vulkan driver: any, or else one that runs on the processor.
shopt -s nullglob
drivers=(/usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json)
if [ "$(uname)" = Linux ] && [ "${#drivers[@]}" -eq 0 ]; then missing+=(mesa-vulkan-drivers libvulkan1); fi
# A display without a screen, for the viewer's window.
if [ "$(uname)" = Linux ] && ! command -v Xvfb >/dev/null; then
    missing+=(xvfb libxkbcommon-x11-0 libxcursor1 libxi6 libx11-xcb1)
fi
if [ "${#missing[@]}" -gt 0 ]; then
    if command -v apt-get >/dev/null; then
        as_root=""
        if [ "$(id -u)" -ne 0 ]; then as_root="sudo"; fi
        $as_root apt-get update
        $as_root apt-get install -y --no-install-recommends "${missing[@]}"
    elif ! command -v c++ >/dev/null; then
        echo "a C++ compiler is missing: install one (g++ or clang++), then run this again" >&2
        exit 1
    fi
fi

if [ "$#" -gt 0 ]; then
    # Some tests, as cargo's flags name them: `bash tests/run.sh --test gpu`.
    exec cargo test --workspace --locked "$@"
fi

# The library is compiled a second time for its own tests: unoptimized, in a sixth of the time. What takes long is in `tests/`.
# Always of the whole workspace: for one package alone others would be compiled again with fewer features.
cargo test --workspace --lib --locked \
    --config profile.test.opt-level=0 --config 'profile.test.package.voxsight-voxel.opt-level=1'
cargo test --workspace --bins --examples --test '*' --locked
cargo test --workspace --doc --locked
# Library users do without the command line, and with one of its features alone.
cargo check --locked --no-default-features --lib
cargo check --locked --no-default-features --features gpu --lib
cargo check --locked --no-default-features --features lab --lib
