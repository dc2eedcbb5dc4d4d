//! Beyond the centres of the outermost texels, clamped images go on as they are there.

#![cfg(feature = "encode")]
#![allow(clippy::unwrap_used, reason = "helpers of tests may fail as tests do")]

use glam::{IVec2, Vec2};
use texfold_core::image::ImageSet;
use texfold_core::{Access, Effort, Encoder, Goal, Job};
use texfold_epitome::decode::{texfold_epitome_bilinear, texfold_epitome_fetch};
use texfold_epitome::{Epitome, EpitomeParams, EpitomeSource};

#[test]
fn clamped_edges_are_drawn_as_their_texels() {
    let set = ImageSet::single(texfold_testkit::image("facade"));
    let params = EpitomeParams::new(Goal::Psnr(28.0))
        .with_access(Access::Texel)
        .with_mips(true)
        .with_effort(Effort::Fast);
    let texture = Epitome::encode(EpitomeSource::new(&set), &params, &mut Job::default()).unwrap();
    let view = texture.view(0);
    for level in 0..5 {
        let side = 256 >> level;
        for along in 0..side {
            let middle = (along as f32 + 0.5) / side as f32;
            // Beyond all four edges, and on them.
            let places = [
                (Vec2::new(-0.3, middle), IVec2::new(0, along)),
                (Vec2::new(0.0, middle), IVec2::new(0, along)),
                (Vec2::new(1.0, middle), IVec2::new(side - 1, along)),
                (Vec2::new(middle, 0.0), IVec2::new(along, 0)),
                (Vec2::new(middle, 1.7), IVec2::new(along, side - 1)),
            ];
            for (uv, at) in places {
                let drawn = texfold_epitome_bilinear(&view, uv, level);
                // At level 0 texels beside a border of leaves are blended.
                let centre = (at.as_vec2() + 0.5) / side as f32;
                let texel = match level {
                    0 => texfold_epitome_bilinear(&view, centre, 0),
                    _ => texfold_epitome_fetch(&view, at, level),
                };
                let away = (drawn - texel).abs().max_element();
                assert!(away < 1e-4, "level {level}, {uv}: {away} away from the texel");
            }
        }
    }
}
