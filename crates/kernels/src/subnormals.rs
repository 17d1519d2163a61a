//! Numbers nearer to 0 than full precision reaches (subnormal ones, below 1e-38) count as 0.
//!
//! Masks that are sure of an object leave gradients as small as that everywhere else, and some processors take a hundred
//! times as long for an operation on them: trainings of objects that look alike took twenty times as long.
//!
//! The compiler takes it that a program never changes this, and may compute with subnormal constants as if they did not count as
//! 0. Nothing here depends on what becomes of them.

use std::marker::PhantomData;

/// Whether a thread reads and writes subnormal numbers as 0: two bits of the vector unit's control register. Elsewhere than on
/// x86-64, and under Miri, there is none, and nothing is changed.
#[derive(Debug, Clone, Copy)]
pub struct Control(#[cfg(all(target_arch = "x86_64", not(miri)))] u32);

#[cfg(all(target_arch = "x86_64", not(miri)))]
mod register {
    use std::arch::asm;

    /// Flush to zero, and denormals are zero.
    pub const FLUSH: u32 = 1 << 15 | 1 << 6;

    pub fn read() -> u32 {
        let mut control = 0u32;
        // SAFETY: the register is written to a number of its size.
        unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut control, options(nostack, preserves_flags)) };
        control
    }

    pub fn set_flush(bits: u32) {
        let control = read() & !FLUSH | bits & FLUSH;
        // SAFETY: what stood in the register but for two bits, which change nothing but the results of operations on subnormal
        // numbers.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const control, options(nostack, readonly)) };
    }
}

impl Control {
    pub fn of_this_thread() -> Self {
        #[cfg(all(target_arch = "x86_64", not(miri)))]
        return Control(register::read());
        #[cfg(not(all(target_arch = "x86_64", not(miri))))]
        Control()
    }

    /// This thread computes like that from now on, and those that it begins.
    pub fn take_over(self) {
        #[cfg(all(target_arch = "x86_64", not(miri)))]
        register::set_flush(self.0);
    }
}

/// From now on subnormal numbers are read and written as 0 by this thread, and by those that it begins.
pub fn flush_subnormals() {
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    register::set_flush(register::FLUSH);
}

/// While it lives, subnormal numbers count as 0 in this thread; then as before.
#[derive(Debug)]
#[must_use = "subnormal numbers count again as soon as this is dropped"]
pub struct Flushing(Control, PhantomData<*const ()>);

impl Flushing {
    pub fn begin() -> Self {
        let before = Control::of_this_thread();
        flush_subnormals();
        Flushing(before, PhantomData)
    }
}

impl Drop for Flushing {
    fn drop(&mut self) {
        self.0.take_over();
    }
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use std::hint::black_box;
    use std::thread;

    use super::Flushing;

    fn tiny() -> f32 {
        black_box(1e-30f32) * black_box(1e-10f32)
    }

    #[test]
    fn what_is_too_small_is_zero_in_this_thread_and_those_it_begins_and_then_as_before() {
        // In a thread of its own, so that other tests compute as ever.
        thread::spawn(|| {
            assert!(tiny() > 0.0);
            let flushing = Flushing::begin();
            assert_eq!([tiny(), thread::spawn(tiny).join().unwrap()], [0.0, 0.0]);
            drop(flushing);
            assert!(tiny() > 0.0);
        })
        .join()
        .unwrap();
    }
}
