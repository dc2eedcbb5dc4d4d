//! Every codec of the facade's table is drawn as the CPU decodes it: a codec that is added there is tested here as it is.

#![allow(clippy::panic, clippy::unwrap_used, reason = "a test fails by panicking")]

use crate::support::{PLACED, assert_close, gpu, image, plane_bound, zipmap};
use glam::Vec4;
use texfold::core::image::ImageSet;
use texfold::{
    Access, AnyImage, CODECS, Effort, EncodeSettings, Encoded, Goal, Guidance, ImageAddress, Input, Job,
    core::Image2d, encoding::ENCODINGS,
};
use texfold_bc::Content;
use texfold_gpu::{Gpu, Lookup, View};

/// Goals that choose unlike content of most codecs.
const GOALS: [Goal; 2] = [Goal::Psnr(30.0), Goal::Bpp(2.0)];

/// Draws every texel of every level and compares it with [`Encoded::texel`].
fn compare(gpu: &Gpu, name: &str, texture: &dyn Encoded<Domain = Image2d>) {
    let form = texture.gpu();
    let uploaded = gpu.upload(&form).unwrap();
    let memory = texture.memory();
    assert_eq!(memory, form.memory(), "{name}");
    assert_eq!(8 * uploaded.bytes(), memory.resident, "{name}");
    match form.access() {
        Access::Texel => assert_eq!(memory.resident, memory.compressed, "{name}"),
        Access::Block => assert!(memory.resident > memory.compressed, "{name}"),
    }
    // Gains are up to 2.
    let bound = Vec4::splat(
        2.0 * form.planes.iter().map(|plane| plane_bound(plane.format)).fold(0.0, f32::max) + PLACED,
    );
    let layout = texture.layout();
    for (index, size) in (0..).zip(&layout.images) {
        for level in 0..layout.levels {
            let size = size.at_level(level);
            let view = View::whole(index, (size.width, size.height), Lookup::Fetch { level });
            let places = (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y)));
            let wanted: Vec<Vec4> =
                places.map(|(x, y)| texture.texel(ImageAddress { image: index, level, x, y })).collect();
            let found = gpu.read_view(&uploaded, &view).unwrap();
            assert_close(&format!("{name}, image {index}, level {level}"), &found, &wanted, |_| bound);
        }
    }
}

#[test]
fn every_codec_of_the_table_is_drawn_as_the_cpu_decodes_it() {
    let Some(gpu) = gpu() else { return };
    let set = ImageSet::single(image("odd_37x61"));
    for codec in &CODECS {
        match codec.takes {
            Input::Images => {
                let rows: Vec<_> = ENCODINGS.iter().filter(|row| row.id == codec.id).collect();
                assert!(!rows.is_empty(), "{} takes images, and nothing encodes them", codec.id);
                for (row, goal) in rows.iter().flat_map(|row| GOALS.map(|goal| (row, goal))) {
                    let settings = EncodeSettings {
                        goal,
                        mips: true,
                        effort: Effort::Fast,
                        ..EncodeSettings::default()
                    };
                    let made = row.encode(&set, Guidance::default(), &settings, &mut Job::default()).unwrap();
                    compare(gpu, &format!("{} {goal:?}", codec.id), made.as_encoded());
                }
            }
            Input::Stack => {
                let made = AnyImage::new(zipmap("odd_37x61", 3, Content::Bc1, 3));
                assert_eq!(made.codec(), codec.id);
                compare(gpu, codec.id.name, made.as_encoded());
            }
            // Drawn in tests/light.rs.
            Input::Capture => assert_eq!(codec.id.name, "lightfield"),
        }
    }
}
