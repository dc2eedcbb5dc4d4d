//! Zipmaps of fixtures under turned, slanted and mirrored matrices.

use glam::{DMat3, DVec2};
use texfold_bc::Content;
use texfold_core::{Access, Effort, Encoder, Goal, Job};
use texfold_zipmap::{PatchSource, PatchStack, ZipParams, ZipTexture, Zipmap};

use super::image;

/// From the root's texture coordinates to those of a patch that lies around `middle`, `zoom` times as large, turned, and slanted.
pub(crate) fn matrix(middle: (f64, f64), zoom: f64, turn: f64, slant: f64) -> DMat3 {
    let mut slanted = DMat3::IDENTITY;
    slanted.x_axis.z = slant;
    DMat3::from_translation(DVec2::splat(0.5))
        * slanted
        * DMat3::from_scale_angle_translation(DVec2::splat(zoom), turn, DVec2::ZERO)
        * DMat3::from_translation(-DVec2::new(middle.0, middle.1))
}

/// Patches in colour or gray over a small root.
pub(crate) fn zipmap(root: &str, channels: u8, content: Content, patches: usize) -> ZipTexture {
    with_params(root, channels, patches, ZipParams::default().with_content(content))
}

/// The same in blocks.
pub(crate) fn zipmap_blocks(root: &str, channels: u8, patches: usize) -> ZipTexture {
    let texture = with_params(root, channels, patches, ZipParams::default().with_goal(Goal::Bpp(3.0)));
    assert_eq!(texture.access(), Access::Block);
    texture
}

fn with_params(root: &str, channels: u8, patches: usize, params: ZipParams) -> ZipTexture {
    let root = image(root).with_channels(channels);
    let images = ["odd_37x61", "gray", "cutout"].map(|name| image(name).with_channels(channels)).to_vec();
    let mut mirrored = matrix((0.3, 0.7), 2.0, 2.0, 0.0);
    mirrored.x_axis.x = -mirrored.x_axis.x;
    let matrices = [
        matrix((0.5, 0.5), 2.0, 0.4, 0.2),
        matrix((0.4, 0.45), 3.1, -1.0, -0.3),
        matrix((0.9, 0.2), 1.7, 0.0, 0.0),
        mirrored,
        matrix((0.45, 0.5), 4.0, 0.1, 0.0),
    ];
    let source = |(index, &matrix): (usize, &DMat3)| PatchSource {
        image: index % 3,
        matrix,
        mask: None,
        parent: None,
    };
    let patches = matrices.iter().cycle().take(patches).enumerate().map(source).collect();
    let params = params.with_tau(0.05).with_drop_rms(0.0).with_effort(Effort::Fast);
    let stack = PatchStack { root, images, patches };
    Zipmap::encode(&stack, &params, &mut Job::default()).unwrap()
}
