//! Numbers nearer to 0 than full precision reaches (subnormal ones, below 1e-38) count as 0.
//!
//! Masks that are sure of an object leave gradients as small as that everywhere else, and some processors take a hundred
//! times as long for an operation on them: trainings of objects that look alike took twenty times as long.

/// How a thread computes with what is too small: the vector unit's control register. Elsewhere than on x86-64 there is none.
#[derive(Debug, Clone, Copy)]
pub struct Control(#[cfg(target_arch = "x86_64")] u32);

impl Control {
    pub fn of_this_thread() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            let mut control = 0u32;
            // SAFETY: the register is written to a number of its size.
            unsafe {
                std::arch::asm!("stmxcsr [{}]", in(reg) &raw mut control, options(nostack, preserves_flags));
            }
            Control(control)
        }
        #[cfg(not(target_arch = "x86_64"))]
        Control()
    }

    /// This thread computes like that from now on, and those that it begins.
    pub fn take_over(self) {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: what stood in the register, with two bits more or not, which change nothing but the results of operations
        // on subnormal numbers.
        unsafe {
            std::arch::asm!("ldmxcsr [{}]", in(reg) &raw const self.0, options(nostack, preserves_flags));
        }
    }
}

/// From now on subnormal numbers are read and written as 0 by this thread, and by those that it begins. Elsewhere than on
/// x86-64 nothing happens.
pub fn flush_subnormals() {
    #[cfg(target_arch = "x86_64")]
    {
        /// Flush to zero, and denormals are zero.
        const FLUSH: u32 = 1 << 15 | 1 << 6;
        Control(Control::of_this_thread().0 | FLUSH).take_over();
    }
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use std::hint::black_box;
    use std::thread;

    use super::flush_subnormals;

    fn tiny() -> f32 {
        black_box(1e-30f32) * black_box(1e-10f32)
    }

    #[test]
    fn what_is_too_small_is_zero_in_this_thread_and_those_it_begins() {
        // In a thread of its own, so that other tests compute as ever.
        thread::spawn(|| {
            assert!(tiny() > 0.0);
            flush_subnormals();
            assert_eq!([tiny(), thread::spawn(tiny).join().unwrap()], [0.0, 0.0]);
        })
        .join()
        .unwrap();
    }
}
