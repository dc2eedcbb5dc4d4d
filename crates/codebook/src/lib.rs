//! Building and searching codebooks: importance-weighted, deterministic, exact.
//!
//! [`build`] is the generalised Lloyd algorithm (Linde, Buzo and Gray 1980) with a weight for each vector, a k-means++
//! start and re-seeding of empty cells. [`Search`] finds exact nearest neighbours fast: vectors are rotated to
//! the principal axes of the codebook, which keeps distances and puts most of them into the first eight numbers, and
//! a k-d tree over those leaves a few hundred of ten thousands to compare. Between rounds only codewords that moved are
//! searched anew (Kaukoranta, Fränti and Nevalainen 2000).
//!
//! Cost: O(n k) distances in the worst case; on image blocks the tree rejects most of them unseen. The result does
//! not depend on the number of threads: work is shared out by vector, and sums run in the order of the vectors.
//!
//! *Not done*: Elkan's bounds (n x k numbers of memory), approximate search (the exact one is fast enough).

mod leaders;
mod lloyd;
mod rotation;
mod search;
mod seeding;

pub use leaders::Leaders;
pub use lloyd::{Codebook, Settings, build, build_unless};
pub use search::{Match, Search};
