//! A short stress run: every class of rays of the bench of that name, judged by its oracles.
#![allow(clippy::expect_used, reason = "a test stops at the first surprise")]

#[path = "../benches/stress/mod.rs"]
mod stress;

use stress::{Depth, Stress};

#[test]
fn no_class_of_rays_breaks_a_promise_of_the_ray_caster() {
    // Enough groups for each class to meet each oracle.
    let stress = Stress::new(3, Depth { reference_every: 1, oracle_every: 2 }).expect("scenes that fit");
    let outcome = stress.run(0..2000);
    outcome.print();
    assert_eq!(outcome.failures, 0, "seed {}", stress.seed);
    assert_eq!(outcome.tallies.untested(), Vec::<&str>::new());
}
