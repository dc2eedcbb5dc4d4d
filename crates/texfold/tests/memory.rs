//! Limits bound what loading and the form for GPUs allocate, and a loaded texture holds little more than its planes: the
//! allocator counts, not the budget's own sum.
//!
//! The tests take turns, as the allocator counts what all threads of the process hold.

#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

mod support;

use std::sync::Mutex;

use peak_alloc::PeakAlloc;
use support::forged::with_changed_section;
use support::target::{self, Forged};
use support::{dct, epitome, fixture, small_textures, stack};
use texfold::{
    AnyTexture,
    core::container::{NOTES_ID, SectionWriter, write_layout},
    open, open_with,
};
use texfold::{
    Effort, EncodeSettings, Family, Goal, Guidance, ImageAddress, Job, Limits,
    bc::Bc,
    core::{Encoder, ImageLayout, ImageSize, Notes, TextureCodec},
    dct::{Dct, DctParams},
    encoding::ENCODINGS,
    epitome::EpitomeParams,
    zipmap::{ZipParams, Zipmap},
};
use texfold_core::image::{ImageSet, PixelInfo, Raster};
use texfold_core::rng::Rng;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Bytes that a loaded texture may hold for each byte that a GPU holds of it: planes and what says where they are. Tables of
/// the CPU decoder, which take ten times as much and more, are made when first asked for.
const HELD: f64 = 1.3;

static TURN: Mutex<()> = Mutex::new(());

/// What no budget books, in bytes: names, a list of sections, work that threads share out.
const SLACK: u64 = 64 << 10;

/// The most bytes that an input of a fuzz target takes: its limit of 16 MiB to load, the same again to load what it was stored as, and what
/// decodes regions.
const MOST_OF_AN_INPUT: usize = 40 << 20;

/// Files with a changed section that are loaded under several limits.
const FORGED: usize = 1500;

/// Textures that allocate more than their limit when they load, are uploaded and sampled. A line here is a defect: the test
/// fails where one is no longer needed.
const OVER: [&str; 0] = [];

/// The most bytes that were held at a time while `bytes` were loaded under `limit`, made ready for a GPU and sampled, and
/// whether they loaded.
fn peak(bytes: &[u8], limit: u64) -> (u64, bool) {
    let before = ALLOCATOR.current_usage();
    ALLOCATOR.reset_peak_usage();
    let opened =
        open_with(bytes, &Limits { bytes: limit, ..Limits::default() }).and_then(AnyTexture::into_image);
    if let Ok(texture) = &opened {
        let texture = texture.as_encoded();
        let form = texture.gpu();
        assert!(!form.images.is_empty());
        drop(form);
        let _ = texture.texel(ImageAddress::default());
    }
    (ALLOCATOR.peak_usage().saturating_sub(before) as u64, opened.is_ok())
}

/// A plain file of one run of `images` images of one texel, and notes.
fn plain_file(images: u32, notes: &[u8]) -> Vec<u8> {
    let size = ImageSize { width: 1, height: 1 };
    let pixel = PixelInfo { channels: 3, ..PixelInfo::default() };
    let mut out = SectionWriter::new(Bc::ID);
    if notes.is_empty() {
        Notes::default().write(&mut out);
    } else {
        out.section("container", NOTES_ID, notes);
    }
    write_layout(&ImageLayout::new(vec![size; images as usize], 1, pixel), &mut out);
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

/// Bytes held of the texture in `bytes` after it was loaded and handed to a GPU, for each byte that the GPU holds.
fn held(bytes: &[u8]) -> f64 {
    let before = ALLOCATOR.current_usage();
    let texture = open(bytes).unwrap().into_image().unwrap();
    let on_gpu = texture.as_encoded().memory().compressed / 8;
    (ALLOCATOR.current_usage() - before) as f64 / on_gpu as f64
}

#[test]
fn opening_for_a_gpu_decodes_nothing() {
    let _turn = TURN.lock().unwrap();
    let facade = fixture("facade");
    let goal = Goal::Psnr(30.0);
    let layered = EpitomeParams::new(goal).with_effort(Effort::Fast).with_layers(3).with_mips(true);
    let coded = EpitomeParams::new(goal).with_effort(Effort::Fast).with_family(Family::ErrorMap);
    let mut textures = vec![
        ("layered epitome".to_owned(), epitome(&facade, &layered)),
        ("epitome with a residual plane".to_owned(), epitome(&facade, &coded)),
        ("dct".to_owned(), dct(&facade, &DctParams::default().with_goal(goal).with_mips(true))),
    ];
    let settings = EncodeSettings { goal, mips: true, effort: Effort::Fast, ..EncodeSettings::default() };
    for encoding in &ENCODINGS {
        let texture = encoding.encode(&facade, Guidance::default(), &settings, &mut Job::default()).unwrap();
        textures.push((encoding.id.name.to_owned(), texture));
    }
    let mut over = Vec::new();
    for (name, texture) in textures {
        let held = held(&texture.to_bytes());
        println!("{name}: {held:.2} bytes held for each on the GPU");
        if held > HELD {
            over.push((name, held));
        }
    }
    assert!(over.is_empty(), "{over:?}");
}

#[test]
fn no_file_makes_a_reader_allocate_more_than_its_limit() {
    let _turn = TURN.lock().unwrap();
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

#[test]
fn no_forged_file_makes_a_reader_allocate_more_than_its_limit() {
    let _turn = TURN.lock().unwrap();
    let mut rng = Rng::new(7);
    let files: Vec<(String, Vec<u8>)> =
        small_textures().iter().map(|(name, _, texture)| (name.clone(), texture.to_bytes())).collect();
    let mut refused = 0;
    for round in 0..FORGED {
        let (name, bytes) = &files[round % files.len()];
        let forged = with_changed_section(bytes, &mut rng).unwrap();
        for limit in [1 << 17, 1 << 20, 1 << 24] {
            let (peak, loaded) = peak(&forged, limit);
            refused += usize::from(!loaded);
            assert!(peak <= limit + SLACK, "{name}, round {round}: {peak} bytes under a limit of {limit}");
        }
    }
    assert!((FORGED / 10..3 * FORGED).contains(&refused), "{refused} refused");
}

/// A fixture with each texel that many times in both directions.
fn enlarged(name: &str, times: u32) -> Raster {
    let image = texfold_testkit::image(name);
    let (width, height) = (times * image.size().width, times * image.size().height);
    let texels: Vec<_> =
        (0..width * height).map(|i| image.texel(i % width / times, i / width / times)).collect();
    Raster::from_texels(width, height, image.info(), &texels).unwrap()
}

#[test]
fn a_zipmap_is_encoded_within_what_its_job_books() {
    let _turn = TURN.lock().unwrap();
    // The root is the largest image, and a patch is.
    for (root, image) in [(3, 2), (1, 8)] {
        let stack = stack(&enlarged("terrain", root), enlarged("cutout", image));
        for goal in [Goal::Psnr(34.0), Goal::Bpp(6.0)] {
            let params = ZipParams::default().with_goal(goal).with_effort(Effort::Fast);
            let mut job = Job::default();
            let before = ALLOCATOR.current_usage();
            ALLOCATOR.reset_peak_usage();
            let texture = Zipmap::encode(&stack, &params, &mut job).unwrap();
            let held = (ALLOCATOR.peak_usage() - before) as u64;
            drop(texture);
            let booked = job.budget.peak_bytes();
            println!("root {root}, image {image}, {goal:?}: {held} bytes held, {booked} booked");
            assert!(
                held <= booked + SLACK,
                "root {root}, image {image}, {goal:?}: {held} held, {booked} booked"
            );
        }
    }
}

/// Encoding with `dct` holds samples, coefficients and quantised levels beside its source, with mips the chain.
/// The inputs of a fuzz target that `cargo xtask fuzz --keep` wrote: each behind its length.
fn kept(target: &str) -> Vec<Vec<u8>> {
    let file = texfold_testkit::fixtures_dir().join("fuzz").join(format!("{target}.bin"));
    let (bytes, mut inputs) = (std::fs::read(file).unwrap(), Vec::new());
    let mut rest = bytes.as_slice();
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let (input, after) = after.split_at(u32::from_le_bytes(*length) as usize);
        inputs.push(input.to_vec());
        rest = after;
    }
    inputs
}

#[test]
fn what_fuzz_targets_keep_finds_nothing_and_takes_little_memory() {
    let _turn = TURN.lock().unwrap();
    let step = if texfold_testkit::full() { 1 } else { 4 };
    let run = |name: &str, input: &[u8]| match name {
        "open" => Some(target::open_any(input)),
        "blocks" => target::open_forged(input, Forged::Blocks),
        _ => target::open_forged(input, Forged::Sections),
    };
    for name in ["open", "blocks", "sections"] {
        // What is made once.
        run(name, &[0; 64]);
        for (number, input) in kept(name).into_iter().enumerate().step_by(step) {
            let before = ALLOCATOR.current_usage();
            ALLOCATOR.reset_peak_usage();
            run(name, &input);
            let peak = ALLOCATOR.peak_usage().saturating_sub(before);
            assert!(peak <= MOST_OF_AN_INPUT, "{name} {number}: {peak} bytes");
        }
    }
}

#[test]
fn blocks_are_encoded_without_copies_of_the_image() {
    let _turn = TURN.lock().unwrap();
    let image = ImageSet::single(enlarged("terrain", 3));
    let texels = image.texel_count() as f64;
    for (goal, mips, most) in
        [(Goal::Bpp(1.0), false, 22.0), (Goal::Bpp(4.0), false, 28.0), (Goal::Psnr(34.0), true, 36.0)]
    {
        let params = DctParams::default().with_goal(goal).with_mips(mips).with_effort(Effort::Fast);
        let before = ALLOCATOR.current_usage();
        ALLOCATOR.reset_peak_usage();
        let texture = Dct::encode(&image, &params, &mut Job::default()).unwrap();
        let held = (ALLOCATOR.peak_usage() - before) as f64 / texels;
        drop(texture);
        assert!(held < most, "{goal:?}, mips {mips}: {held:.1} bytes a texel");
    }
}
