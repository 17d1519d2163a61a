//! Vectors of floats, one lane for each frame, in the three widths that a processor may have.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::*;

/// A vector of float32.
///
/// # Safety
/// The methods of the x86 types use instructions that the processor must have; they are reached only through
/// [`dispatched`], which asks it. Pointers are to `LANES` floats, unaligned.
pub trait Lanes: Copy {
    const LANES: usize;
    /// Output channels in a tile of a convolution; they and the pixels beside each other fill the registers.
    const OUTPUTS: usize;

    unsafe fn load(from: *const f32) -> Self;
    unsafe fn store(self, to: *mut f32);
    unsafe fn splat(value: f32) -> Self;
    unsafe fn add(self, other: Self) -> Self;
    unsafe fn sub(self, other: Self) -> Self;
    unsafe fn mul(self, other: Self) -> Self;
    /// `self + a b`.
    unsafe fn add_product(self, a: Self, b: Self) -> Self;
    /// The greater; `other` where one of them is not a number.
    unsafe fn max(self, other: Self) -> Self;
    /// `self` where `gate` is above 0, else 0.
    unsafe fn where_positive(self, gate: Self) -> Self;
    /// `(a, b)` is `(self, 0)` where `x` equals `y`, else `(0, self)`.
    unsafe fn split_equal(self, x: Self, y: Self) -> (Self, Self);
    /// The sum of all lanes.
    unsafe fn sum(self) -> f32;
    /// The sum of all lanes of each of four vectors.
    unsafe fn sums(vectors: [Self; 4]) -> [f32; 4];

    /// Asks for a vector that will be read or written soon. An address where nothing is does no harm.
    #[inline(always)]
    unsafe fn fetch(_from: *const f32) {}

    /// As many vectors as they have lanes, `apart` floats from each other, with lanes and vectors exchanged.
    #[inline(always)]
    unsafe fn transpose(from: *const f32, apart: usize, to: *mut f32) {
        for row in 0..Self::LANES {
            for lane in 0..Self::LANES {
                unsafe { *to.add(lane * Self::LANES + row) = *from.add(row * apart + lane) };
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[derive(Debug, Clone, Copy)]
pub struct Avx512(__m512);

#[cfg(target_arch = "x86_64")]
impl Lanes for Avx512 {
    const LANES: usize = 16;
    const OUTPUTS: usize = 8;

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        unsafe { Avx512(_mm512_loadu_ps(from)) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        unsafe { _mm512_storeu_ps(to, self.0) }
    }

    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        unsafe { Avx512(_mm512_set1_ps(value)) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        unsafe { Avx512(_mm512_add_ps(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        unsafe { Avx512(_mm512_sub_ps(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        unsafe { Avx512(_mm512_mul_ps(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn add_product(self, a: Self, b: Self) -> Self {
        unsafe { Avx512(_mm512_fmadd_ps(a.0, b.0, self.0)) }
    }

    #[inline(always)]
    unsafe fn max(self, other: Self) -> Self {
        unsafe { Avx512(_mm512_max_ps(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn where_positive(self, gate: Self) -> Self {
        unsafe { Avx512(_mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(gate.0, _mm512_setzero_ps()), self.0)) }
    }

    #[inline(always)]
    unsafe fn split_equal(self, x: Self, y: Self) -> (Self, Self) {
        unsafe {
            let equal = _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(x.0, y.0);
            (Avx512(_mm512_maskz_mov_ps(equal, self.0)), Avx512(_mm512_maskz_mov_ps(!equal, self.0)))
        }
    }

    #[inline(always)]
    unsafe fn sum(self) -> f32 {
        unsafe { _mm512_reduce_add_ps(self.0) }
    }

    #[inline(always)]
    unsafe fn sums([a, b, c, d]: [Self; 4]) -> [f32; 4] {
        unsafe {
            let quarters = pairs(pairs(a.0, b.0), pairs(c.0, d.0));
            let half = _mm_add_ps(_mm512_castps512_ps128(quarters), _mm512_extractf32x4_ps::<1>(quarters));
            let other = _mm_add_ps(_mm512_extractf32x4_ps::<2>(quarters), _mm512_extractf32x4_ps::<3>(quarters));
            std::mem::transmute::<__m128, [f32; 4]>(_mm_add_ps(half, other))
        }
    }

    #[inline(always)]
    unsafe fn fetch(from: *const f32) {
        unsafe { _mm_prefetch::<_MM_HINT_T1>(from.cast()) }
    }

    #[inline(always)]
    unsafe fn transpose(from: *const f32, apart: usize, to: *mut f32) {
        unsafe {
            for half in 0..2 {
                // Of four rows at a time: a quarter of a vector has, of four columns beside each other, one.
                let mut fours = [[_mm512_setzero_ps(); 2]; 4];
                for (four, columns) in fours.iter_mut().enumerate() {
                    let row = |i: usize| _mm512_loadu_ps(from.add((4 * four + i) * apart));
                    let pair = |a, b| if half == 0 { _mm512_unpacklo_ps(a, b) } else { _mm512_unpackhi_ps(a, b) };
                    let (upper, lower) = (pair(row(0), row(1)), pair(row(2), row(3)));
                    let (upper, lower) = (_mm512_castps_pd(upper), _mm512_castps_pd(lower));
                    columns[0] = _mm512_castpd_ps(_mm512_unpacklo_pd(upper, lower));
                    columns[1] = _mm512_castpd_ps(_mm512_unpackhi_pd(upper, lower));
                }
                let [a, b, c, d] = fours;
                for (i, fours) in [[a[0], b[0], c[0], d[0]], [a[1], b[1], c[1], d[1]]].iter().enumerate() {
                    let even = [0, 2].map(|j| _mm512_shuffle_f32x4::<0x88>(fours[j], fours[j + 1]));
                    let odd = [0, 2].map(|j| _mm512_shuffle_f32x4::<0xdd>(fours[j], fours[j + 1]));
                    let place = |quarter: usize| to.add((4 * quarter + 2 * half + i) * 16);
                    _mm512_storeu_ps(place(0), _mm512_shuffle_f32x4::<0x88>(even[0], even[1]));
                    _mm512_storeu_ps(place(1), _mm512_shuffle_f32x4::<0x88>(odd[0], odd[1]));
                    _mm512_storeu_ps(place(2), _mm512_shuffle_f32x4::<0xdd>(even[0], even[1]));
                    _mm512_storeu_ps(place(3), _mm512_shuffle_f32x4::<0xdd>(odd[0], odd[1]));
                }
            }
        }
    }
}

/// Neighbours of two vectors, added, in each quarter.
///
/// # Safety
/// As of [`Lanes`]. As a closure it was not compiled into its caller.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
unsafe fn pairs(a: __m512, b: __m512) -> __m512 {
    unsafe { _mm512_add_ps(_mm512_shuffle_ps::<0x88>(a, b), _mm512_shuffle_ps::<0xdd>(a, b)) }
}

#[cfg(target_arch = "x86_64")]
#[derive(Debug, Clone, Copy)]
pub struct Avx2(__m256);

#[cfg(target_arch = "x86_64")]
impl Lanes for Avx2 {
    const LANES: usize = 8;
    const OUTPUTS: usize = 4;

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        unsafe { Avx2(_mm256_loadu_ps(from)) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        unsafe { _mm256_storeu_ps(to, self.0) }
    }

    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        unsafe { Avx2(_mm256_set1_ps(value)) }
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        unsafe { Avx2(_mm256_add_ps(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        unsafe { Avx2(_mm256_sub_ps(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        unsafe { Avx2(_mm256_mul_ps(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn add_product(self, a: Self, b: Self) -> Self {
        unsafe { Avx2(_mm256_fmadd_ps(a.0, b.0, self.0)) }
    }

    #[inline(always)]
    unsafe fn max(self, other: Self) -> Self {
        unsafe { Avx2(_mm256_max_ps(self.0, other.0)) }
    }

    #[inline(always)]
    unsafe fn where_positive(self, gate: Self) -> Self {
        unsafe { Avx2(_mm256_and_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(gate.0, _mm256_setzero_ps()), self.0)) }
    }

    #[inline(always)]
    unsafe fn split_equal(self, x: Self, y: Self) -> (Self, Self) {
        unsafe {
            let equal = _mm256_cmp_ps::<_CMP_EQ_OQ>(x.0, y.0);
            (Avx2(_mm256_and_ps(equal, self.0)), Avx2(_mm256_andnot_ps(equal, self.0)))
        }
    }

    #[inline(always)]
    unsafe fn sum(self) -> f32 {
        unsafe {
            let half = _mm_add_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0));
            let quarter = _mm_add_ps(half, _mm_movehl_ps(half, half));
            _mm_cvtss_f32(_mm_add_ss(quarter, _mm_shuffle_ps::<1>(quarter, quarter)))
        }
    }

    #[inline(always)]
    unsafe fn sums([a, b, c, d]: [Self; 4]) -> [f32; 4] {
        unsafe {
            let halves = _mm256_hadd_ps(_mm256_hadd_ps(a.0, b.0), _mm256_hadd_ps(c.0, d.0));
            let sums = _mm_add_ps(_mm256_castps256_ps128(halves), _mm256_extractf128_ps::<1>(halves));
            std::mem::transmute::<__m128, [f32; 4]>(sums)
        }
    }

    #[inline(always)]
    unsafe fn fetch(from: *const f32) {
        unsafe { _mm_prefetch::<_MM_HINT_T1>(from.cast()) }
    }
}

/// For every other processor: the compiler makes of it what it can.
#[derive(Debug, Clone, Copy)]
pub struct Portable([f32; 4]);

impl Portable {
    #[inline(always)]
    fn map(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Portable(std::array::from_fn(|lane| f(self.0[lane], other.0[lane])))
    }
}

impl Lanes for Portable {
    const LANES: usize = 4;
    const OUTPUTS: usize = 4;

    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        unsafe { Portable(from.cast::<[f32; 4]>().read_unaligned()) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        unsafe { to.cast::<[f32; 4]>().write_unaligned(self.0) }
    }

    #[inline(always)]
    unsafe fn splat(value: f32) -> Self {
        Portable([value; 4])
    }

    #[inline(always)]
    unsafe fn add(self, other: Self) -> Self {
        self.map(other, |a, b| a + b)
    }

    #[inline(always)]
    unsafe fn sub(self, other: Self) -> Self {
        self.map(other, |a, b| a - b)
    }

    #[inline(always)]
    unsafe fn mul(self, other: Self) -> Self {
        self.map(other, |a, b| a * b)
    }

    #[inline(always)]
    unsafe fn add_product(self, a: Self, b: Self) -> Self {
        self.map(a.map(b, |a, b| a * b), |sum, product| sum + product)
    }

    #[inline(always)]
    unsafe fn max(self, other: Self) -> Self {
        self.map(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    unsafe fn where_positive(self, gate: Self) -> Self {
        self.map(gate, |value, gate| if gate > 0.0 { value } else { 0.0 })
    }

    #[inline(always)]
    unsafe fn split_equal(self, x: Self, y: Self) -> (Self, Self) {
        let equal: [bool; 4] = std::array::from_fn(|lane| x.0[lane] == y.0[lane]);
        let keep =
            |which: bool| Portable(std::array::from_fn(|lane| if equal[lane] == which { self.0[lane] } else { 0.0 }));
        (keep(true), keep(false))
    }

    #[inline(always)]
    unsafe fn sum(self) -> f32 {
        (self.0[0] + self.0[1]) + (self.0[2] + self.0[3])
    }

    #[inline(always)]
    unsafe fn sums(vectors: [Self; 4]) -> [f32; 4] {
        unsafe { vectors.map(|vector| vector.sum()) }
    }
}

/// Which instructions the kernels use. Only those that the processor has can be had.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Instructions(Set);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Set {
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    Portable,
}

impl Instructions {
    /// All that this processor has, the widest first.
    pub fn all() -> Vec<Self> {
        let mut sets = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f") {
                sets.push(Instructions(Set::Avx512));
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                sets.push(Instructions(Set::Avx2));
            }
        }
        sets.push(Instructions(Set::Portable));
        sets
    }

    /// As `PAIG_INSTRUCTIONS` names them.
    pub fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => "avx512",
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => "avx2",
            Set::Portable => "portable",
        }
    }

    /// Frames in a block.
    pub fn lanes(self) -> usize {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => Avx512::LANES,
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => Avx2::LANES,
            Set::Portable => Portable::LANES,
        }
    }

    /// Output channels in a tile of a convolution, [`Lanes::OUTPUTS`].
    pub(super) fn tile(self) -> usize {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => Avx512::OUTPUTS,
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => Avx2::OUTPUTS,
            Set::Portable => Portable::OUTPUTS,
        }
    }

    pub(super) fn set(self) -> Set {
        self.0
    }
}

/// Makes of a function that is generic over [`Lanes`] one that takes [`Instructions`] first: it is compiled once for each
/// set of instructions, and the one that was asked for is called.
macro_rules! dispatched {
    ($(#[$attribute:meta])* fn $name:ident($($argument:ident: $type:ty),* $(,)?) = $generic:ident) => {
        $(#[$attribute])*
        pub fn $name(instructions: $crate::simd::Instructions, $($argument: $type),*) {
            use $crate::simd::{self, Set};

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f")]
            fn avx512($($argument: $type),*) {
                $generic::<simd::Avx512>($($argument),*)
            }

            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2($($argument: $type),*) {
                $generic::<simd::Avx2>($($argument),*)
            }

            match instructions.set() {
                // SAFETY: `Instructions` are only made where the processor has them.
                #[cfg(target_arch = "x86_64")]
                Set::Avx512 => unsafe { avx512($($argument),*) },
                #[cfg(target_arch = "x86_64")]
                Set::Avx2 => unsafe { avx2($($argument),*) },
                Set::Portable => $generic::<simd::Portable>($($argument),*),
            }
        }
    };
}

pub(super) use dispatched;
