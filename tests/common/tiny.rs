//! A config for runs that only have to be there.

/// A run of spring clips that takes a second.
pub const TINY: &str = "[discover]\nframes = 4\nmax_steps = 2\n[identify]\nclips = 2\nhorizons = [3]\nmax_iterations = 1\n\
    [join]\nbatch = 2\nmax_steps = 2\nvalidation_clips = 2\n[output]\nexamples = 0\n";
