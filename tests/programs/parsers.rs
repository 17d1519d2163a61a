//! What reads files of strangers comes back with a value or an error, whatever the bytes: some thousand inputs for each
//! reader, made from sound ones. `cargo run --release --example fuzz` goes on for millions.

use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::inputs::{TARGETS, mutate};
use paig_video::import::sources::quiet_decoders;
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

#[test]
fn readers_come_back_from_any_bytes() {
    quiet_decoders();
    // A path that climbs twice ends in the root.
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("a/b");
    std::fs::create_dir_all(&folder).unwrap();
    for target in TARGETS {
        let examples = (target.examples)(&folder);
        for example in &examples {
            (target.read)(example, &folder);
        }
        // `examples/fuzz.rs` goes on for as long as it is told.
        let cases = if target.quick { 200 } else { 20 };
        let mut runner = TestRunner::new(Config { cases, failure_persistence: None, ..Config::default() });
        // A mutation by its seed, or bytes out of nothing.
        let input = prop_oneof![
            8 => any::<u64>().prop_map(|seed| (Some(seed), Vec::new())),
            1 => proptest::collection::vec(any::<u8>(), 0..300).prop_map(|bytes| (None, bytes)),
        ];
        let outcome = runner.run(&input, |(seed, bytes)| {
            let bytes = seed.map_or(bytes, |seed| mutate(&mut ChaCha8Rng::seed_from_u64(seed), &examples));
            catch_unwind(AssertUnwindSafe(|| (target.read)(&bytes, &folder))).map_err(|_| {
                TestCaseError::fail(format!("{} panics at {:?}", target.name, String::from_utf8_lossy(&bytes)))
            })
        });
        outcome.unwrap_or_else(|error| panic!("{}: {error}", target.name));
    }
    // No reader wrote outside its folder, and none followed a path in what it read.
    for place in [root.path(), &root.path().join("a")] {
        assert_eq!(std::fs::read_dir(place).unwrap().count(), 1);
    }
}
