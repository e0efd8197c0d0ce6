use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use sha2::{Digest, Sha256};

/// The random number generator of the suite. A named algorithm, so that its stream stays the same across releases.
pub type Rng = Xoshiro256PlusPlus;

/// A seed derived from the purpose of a random draw. Seeds are never passed from one draw to the next, so
/// results do not depend on the order of work or the number of threads.
///
/// # Example
/// ```
/// use mcl_core::Seed;
///
/// let noise = Seed::new(7).derive("odometry-noise").derive("intel-lab").derive_index(3);
/// assert_eq!(noise, Seed::new(7).derive("odometry-noise").derive("intel-lab").derive_index(3));
/// assert_ne!(noise, Seed::new(7).derive("odometry-noise").derive("intel-lab").derive_index(4));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Seed([u8; 32]);

impl Seed {
    /// Creates the root seed from a number given by the user.
    pub fn new(seed: u64) -> Self {
        Seed(digest(b"root", &[0; 32], &seed.to_le_bytes()))
    }

    /// Derives the seed of a named part: the purpose of a draw, a data set, a split.
    pub fn derive(&self, name: &str) -> Self {
        Seed(digest(b"name", &self.0, name.as_bytes()))
    }

    /// Derives the seed of a numbered part: a run, a step, a repetition.
    pub fn derive_index(&self, index: u64) -> Self {
        Seed(digest(b"index", &self.0, &index.to_le_bytes()))
    }

    /// The first eight bytes of the seed, little-endian, for use with [`Seed::new`]. The result is a new root, not
    /// the same seed.
    pub fn number(&self) -> u64 {
        u64::from_le_bytes(std::array::from_fn(|i| self.0[i]))
    }

    /// Creates a generator with this seed.
    pub fn rng(&self) -> Rng {
        Xoshiro256PlusPlus::from_seed(self.0)
    }
}

/// SHA-256 of kind, parent and part. The kind contains no zero byte and the parent has a fixed length, so
/// different derivations never hash the same bytes.
fn digest(kind: &[u8], parent: &[u8; 32], part: &[u8]) -> [u8; 32] {
    let mut hash = Sha256::new();
    hash.update(kind);
    hash.update([0]);
    hash.update(parent);
    hash.update(part);
    hash.finalize().into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_xoshiro::rand_core::Rng as _;

    /// Pinned values, so that no dependency can silently change results.
    #[test]
    fn stream_is_stable() {
        let mut rng = Seed::new(1).derive("map").derive_index(2).rng();
        let draws: [u64; 3] = std::array::from_fn(|_| rng.next_u64());
        assert_eq!(
            draws,
            [15_690_374_031_167_773_632, 12_909_808_252_752_178_693, 3_745_065_162_085_825_991]
        );
    }

    #[test]
    fn every_part_of_the_identity_matters() {
        let root = Seed::new(1);
        let seeds = [
            root,
            Seed::new(2),
            root.derive("a"),
            root.derive("b"),
            root.derive("a").derive("b"),
            root.derive("ab"),
            root.derive_index(0),
            root.derive_index(1),
            root.derive("\0\0\0\0\0\0\0\0"),
        ];
        for (i, a) in seeds.iter().enumerate() {
            for b in &seeds[..i] {
                assert_ne!(a, b);
            }
        }
    }
}
