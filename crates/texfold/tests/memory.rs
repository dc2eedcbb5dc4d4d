//! Limits bound what loading and the form for GPUs allocate: the allocator counts, not the budget's own sum.
//!
//! One test alone, as the allocator counts what all threads of the process hold.

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

mod support;

use peak_alloc::PeakAlloc;
use support::small_textures;
use texfold::container::{NOTES_ID, SectionWriter, write_layout};
use texfold::{Bc, Budget, ImageAddress, ImageLayout, Limits, Notes, SurfaceSize, TextureCodec, open_image};
use texfold_core::image::PixelInfo;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// What no budget books, in bytes: names, a list of sections, work that threads share out.
const SLACK: u64 = 64 << 10;

/// Textures that allocate more than their limit when they load, are uploaded and sampled. A line here is a defect: the test
/// fails where one is no longer needed.
const OVER: [&str; 0] = [];

/// The most bytes that were held at a time while `bytes` were loaded under `limit`, made ready for a GPU and sampled, and
/// whether they loaded.
fn peak(bytes: &[u8], limit: u64) -> (u64, bool) {
    let before = ALLOCATOR.current_usage();
    ALLOCATOR.reset_peak_usage();
    let mut budget = Budget::new(Limits { bytes: limit, ..Limits::default() });
    let opened = open_image(bytes, &mut budget);
    if let Ok(texture) = &opened {
        let texture = texture.as_encoded();
        let form = texture.gpu();
        assert!(!form.surfaces.is_empty());
        drop(form);
        let _ = texture.sample(ImageAddress::default());
    }
    (ALLOCATOR.peak_usage().saturating_sub(before) as u64, opened.is_ok())
}

/// A plain file of one run of `images` images of one texel, and notes.
fn plain_file(images: u32, notes: &[u8]) -> Vec<u8> {
    let size = SurfaceSize { width: 1, height: 1 };
    let pixel = PixelInfo { channels: 3, ..PixelInfo::default() };
    let mut out = SectionWriter::new(Bc::ID);
    if notes.is_empty() {
        Notes::default().write(&mut out);
    } else {
        out.section("container", NOTES_ID, notes);
    }
    write_layout(&ImageLayout { surfaces: vec![size; images as usize], levels: 1, pixel }, &mut out);
    out.section("container", *b"BCFM", &[1, 0]);
    out.section("blocks", *b"BLKS", &vec![0; 8 * images as usize]);
    out.finish().bytes
}

/// The least limit, in powers of two, under which a file loads, and by how much the allocator exceeds any limit up to it.
fn excess(bytes: &[u8]) -> (u64, u64) {
    let mut worst = 0;
    for log2 in 10..34 {
        let (peak, loaded) = peak(bytes, 1 << log2);
        worst = worst.max(peak.saturating_sub(1 << log2));
        if loaded {
            return (1 << log2, worst);
        }
    }
    (u64::MAX, worst)
}

#[test]
fn no_file_makes_a_reader_allocate_more_than_its_limit() {
    // Many images of one texel, which compress to nothing.
    let many = plain_file(1 << 18, &[]);
    assert!(many.len() < 4096);
    let (limit, worst) = excess(&many);
    assert!(limit < 1 << 30 && worst <= SLACK, "{worst} bytes above {limit}");
    // Notes of as many empty parts as fit 4 MiB.
    let empty_parts = [vec![0; 4], [0, 0, 1, 0, b'0'].repeat(1 << 20)].concat();
    let (limit, worst) = excess(&plain_file(1, &empty_parts));
    assert!(limit == u64::MAX && worst <= SLACK, "{worst} bytes above {limit}");
    let mut over = Vec::new();
    for (name, _, texture) in small_textures() {
        let (limit, worst) = excess(&texture.to_bytes());
        assert!(limit < 1 << 30, "{name} does not load");
        if worst > SLACK {
            eprintln!("{name}: {worst} bytes above {limit}");
            over.push(name);
        }
    }
    assert_eq!(over, OVER, "see the list OVER");
}
