//! Gathering records of the grid into vectors with loads of 16 bytes and a transposition in registers,
//! instead of copying single numbers through memory.

use pulp::{Arch, NullaryFnOnce};

use super::grid::Record;

/// Number of records gathered at a time.
pub(super) const LANES: usize = 8;
/// Lists of positions are padded to multiples of this: vectors of 512 bits.
pub(super) const PADDING: usize = 16;

/// The two candidates of [`LANES`] records, coordinate by coordinate.
pub(super) struct CandidatePairs {
    pub x: [[f32; LANES]; 2],
    pub y: [[f32; LANES]; 2],
    /// One bit per record, set if its candidates are in a list.
    pub overfull: u32,
}

/// A method of gathering records; all give the same numbers.
pub(super) trait Fetch: Copy {
    fn fetch(self, table: &[Record], numbers: &[u32; LANES]) -> CandidatePairs;
}

/// The method for any machine.
#[derive(Clone, Copy)]
pub(super) struct Portable;

impl Fetch for Portable {
    #[inline(always)]
    fn fetch(self, table: &[Record], numbers: &[u32; LANES]) -> CandidatePairs {
        let mut candidates =
            CandidatePairs { x: [[0.0; LANES]; 2], y: [[0.0; LANES]; 2], overfull: 0 };
        for (lane, &number) in numbers.iter().enumerate() {
            let [one, other] = table[number as usize];
            candidates.overfull |= u32::from(one[0].is_nan()) << lane;
            candidates.x[0][lane] = one[0];
            candidates.y[0][lane] = one[1];
            candidates.x[1][lane] = other[0];
            candidates.y[1][lane] = other[1];
        }
        candidates
    }
}

#[cfg(target_arch = "x86_64")]
impl Fetch for pulp::x86::V3 {
    #[inline(always)]
    fn fetch(self, table: &[Record], numbers: &[u32; LANES]) -> CandidatePairs {
        use pulp::cast;
        let avx = self.avx;
        // Two records side by side. A macro, because code that is not inlined here would lose the wide instructions.
        macro_rules! pair {
            ($low:literal, $high:literal) => {
                avx._mm256_insertf128_ps::<1>(
                    avx._mm256_castps128_ps256(cast(table[numbers[$low] as usize])),
                    cast(table[numbers[$high] as usize]),
                )
            };
        }
        let (a, b, c, d) = (pair!(0, 4), pair!(1, 5), pair!(2, 6), pair!(3, 7));
        let (one_ab, other_ab) = (avx._mm256_unpacklo_ps(a, b), avx._mm256_unpackhi_ps(a, b));
        let (one_cd, other_cd) = (avx._mm256_unpacklo_ps(c, d), avx._mm256_unpackhi_ps(c, d));
        let x = avx._mm256_shuffle_ps::<0x44>(one_ab, one_cd);
        // Unordered means NaN.
        let overfull = avx._mm256_movemask_ps(avx._mm256_cmp_ps::<3>(x, x));
        CandidatePairs {
            overfull: overfull as u32,
            x: [cast(x), cast(avx._mm256_shuffle_ps::<0x44>(other_ab, other_cd))],
            y: [
                cast(avx._mm256_shuffle_ps::<0xee>(one_ab, one_cd)),
                cast(avx._mm256_shuffle_ps::<0xee>(other_ab, other_cd)),
            ],
        }
    }
}

/// A computation that gathers records.
pub(super) trait Task {
    fn run<F: Fetch>(self, fetch: F);
}

/// Runs a task with the widest instructions of the machine.
pub(super) fn dispatch(task: impl Task) {
    dispatch_on(Arch::new(), task);
}

pub(super) fn dispatch_on(arch: Arch, task: impl Task) {
    match arch {
        #[cfg(all(target_arch = "x86_64", feature = "avx512"))]
        Arch::V4(simd) => simd.vectorize(With { fetch: *simd, task }),
        #[cfg(target_arch = "x86_64")]
        Arch::V3(simd) => simd.vectorize(With { fetch: simd, task }),
        _ => task.run(Portable),
    }
}

/// The instruction sets that the machine supports.
#[cfg(test)]
pub(super) fn instruction_sets() -> Vec<Arch> {
    let mut sets = vec![Arch::Scalar];
    #[cfg(target_arch = "x86_64")]
    sets.extend(pulp::x86::V3::try_new().map(Arch::V3));
    #[cfg(all(target_arch = "x86_64", feature = "avx512"))]
    sets.extend(pulp::x86::V4::try_new().map(Arch::V4));
    sets
}

/// Not a closure: the compiler's adapter around a closure would not be inlined, and its instructions
/// would be the narrow ones.
struct With<F, T> {
    fetch: F,
    task: T,
}

impl<F: Fetch, T: Task> NullaryFnOnce for With<F, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.task.run(self.fetch);
    }
}
