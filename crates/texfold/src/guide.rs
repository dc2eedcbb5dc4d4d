//! How-tos: from a folder of images to textures in a renderer.
//!
//! 1. [Compress a folder](#compress-a-folder)
//! 2. [Pick a goal](#pick-a-goal)
//! 3. [Embed](#embed)
//! 4. [Capture a light field](#capture-a-light-field)
//! 5. [Build a zoom stack](#build-a-zoom-stack)
//! 6. [Share codebooks in a bank](#share-codebooks-in-a-bank)
//! 7. [Draw from a cache of tiles](#draw-from-a-cache-of-tiles)
//! 8. [Sequences, and what matters in them](#sequences-and-what-matters-in-them)
//!
//! # Compress a folder
//!
//! The program `texfold` encodes files, folders and globs; a folder is one set of images in one file unless `--as
//! image` is given:
//!
//! ```sh
//! texfold compress textures/*.png --out packed --psnr 36
//! texfold compress textures --as set --out packed --bpp 2 --mips
//! texfold info packed/textures.txf
//! texfold decompress packed/textures.txf --out check
//! texfold decompress packed/textures.txf --out check --image 2 --region 64,0,256,128 --to tiff
//! texfold decompress packed/textures.txf --out engine --to bc7 --container dds
//! ```
//!
//! Outputs have the texture's 8 or 16 bits a channel. Existing files are overwritten only with `--force`.
//! The georeference of a GeoTIFF that is compressed alone is kept: `info` prints it, and `--to tiff` writes it, also of a rectangle or a
//! mip level.
//!
//! The same in code. Images of a set may differ in size, but have the same channels and meaning:
//!
//! ```
//! use texfold::{EncodeSettings, Guidance, ImageSet, Job, Raster, encode_images};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let rasters = vec![texfold_testkit::image("odd_37x61"), texfold_testkit::image("odd_3x5")];
//! // let rasters: Vec<Raster> = the decoded files
//! let set = ImageSet::new(rasters)?;
//! let texture = encode_images(&set, Guidance::default(), &EncodeSettings::default(), &mut Job::default())?;
//! assert_eq!(texture.as_encoded().layout().images.len(), 2);
//! println!("{}: {}", texture.codec().name, texture.as_encoded().notes().verdict);
//! # Ok(())
//! # }
//! ```
//!
//! # Pick a goal
//!
//! A [`Goal`](crate::Goal) is one of three: at least so many dB ([`Goal::Psnr`](crate::Goal::Psnr), 34 by default), at
//! most so many compressed bits per texel ([`Goal::Bpp`](crate::Goal::Bpp)), or a bound for the error of every 4x4
//! block ([`Goal::Tolerance`](crate::Goal::Tolerance)). Without a codec's name the codec is chosen that answers the
//! goal best. Settings of one codec enter as its own parameters:
//!
//! ```
//! use texfold::{Choice, Effort, EncodeSettings, Goal, vq::{Vq, VqParams}};
//!
//! let small = EncodeSettings { goal: Goal::Bpp(1.5), effort: Effort::High, ..EncodeSettings::default() };
//! let named = EncodeSettings { codec: Choice::of::<Vq>(), ..small.clone() };
//! // Importance does not weigh; whether vq or plain blocks are used is still open.
//! let mut own = VqParams::default();
//! own.importance = 0.0;
//! let weighed = EncodeSettings { codec: Choice::auto().with::<Vq>(own), ..small };
//! assert_eq!(weighed.params::<Vq>().goal, Goal::Bpp(1.5));
//! # let _ = named;
//! ```
//!
//! `dct` takes fewest bits and is decoded before it is drawn, `progressive` is read texel by texel; errors count as the eye sees
//! them, or alike. [`GpuForm::access`](crate::core::GpuForm::access) says which way a
//! texture is read:
//!
//! ```
//! use texfold::{Access, Choice, EncodeSettings, Encoded, Goal, Guidance, ImageSet, Job, Metric, encode_images, dct::Dct, progressive::Progressive};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let set = ImageSet::single(texfold_testkit::image("facade"));
//! let settings = EncodeSettings { codec: Choice::of::<Dct>(), goal: Goal::Bpp(1.0), ..EncodeSettings::default() };
//! let exact = EncodeSettings { metric: Some(Metric::Psnr), ..settings.clone() };
//! let scattered = EncodeSettings { codec: Choice::of::<Progressive>(), ..settings.clone() };
//! for (settings, access) in [(settings, Access::Block), (exact, Access::Block), (scattered, Access::Texel)] {
//!     let texture = encode_images(&set, Guidance::default(), &settings, &mut Job::default())?;
//!     assert_eq!(texture.as_encoded().gpu().access(), access);
//! }
//! # Ok(())
//! # }
//! ```
//!
//! What a file came to is measured from the file itself:
//!
//! ```
//! use texfold::{Encode, Goal, ImageSet, core::metric::measure, open};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let set = ImageSet::single(texfold_testkit::image("odd_37x61"));
//! let goal = Goal::Psnr(30.0);
//! let bytes = Encode::new(&set).goal(goal).run()?.to_bytes();
//! let measured = measure(&set, open(&bytes)?.into_image()?.as_encoded());
//! assert!(goal.is_met(&measured), "{measured:?}");
//! # Ok(())
//! # }
//! ```
//!
//! # Embed
//!
//! ```no_run
#![doc = include_str!("../examples/embed.rs")]
//! ```
//!
//! (It writes a file, so documentation tests only compile it; `cargo run -p texfold --example embed` runs it.) A game
//! that only reads takes the crate without the encoders: see the [lines of Cargo.toml](crate#cargotoml). A file that
//! arrives over a network is drawn layer by layer with [`Arriving`](crate::Arriving).
//!
//! # Capture a light field
//!
//! A light field is a mesh and photographs of it with their cameras: a folder with `transforms.json` (as NeRF tools
//! write it) or a model of COLMAP (`images.txt` and `cameras.txt`, or `.bin`, there or in `sparse/0`), a scene of OpenMVS (`scene.mvs`), cameras that Metashape exported (any `.xml`) or
//! Middlebury's `*_par.txt`, the images, and `mesh.obj`, `mesh.ply`, `mesh.glb` or the mesh of COLMAP or OpenMVS in the cameras' space.
//! Lenses with k1 to k4, p1 and p2 and fisheye lenses are undistorted, as far as a pinhole of their focal length sees. Pixels with alpha 0 do not show the object:
//! mask what the mesh does not cover. From photographs to a capture with COLMAP:
//!
//! ```sh
//! colmap automatic_reconstructor --workspace_path work --image_path photos
//! mv work/dense/0 captures/statue      # images, sparse/*.bin and meshed-poisson.ply
//! ```
//!
//! COLMAP's mesh lies in the space of COLMAP's cameras; a `transforms.json` that nerfstudio made of them is turned and scaled
//! (`applied_transform`), and needs a mesh that is, too. From Metashape, export cameras and model in local coordinates. Then:
//!
//! ```sh
//! texfold compress captures/statue --out packed --psnr 32
//! texfold render packed/statue.txf --camera path.json --out frames
//! ```
//!
//! ```
//! use texfold::{Job, file_of, open, core::Encoder, lightfield::{LightParams, Lightfield, Renderer}};
//! # use texfold_testkit::capture::{Look, sphere};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let capture = sphere(Look::Glossy, 8, 24);
//! // let capture = texfold_capture::read("captures/statue".as_ref(), None, None, texfold_capture::read_image)?;
//! let texture = Lightfield::encode(&capture, &LightParams::default(), &mut Job::default())?;
//! let texture = open(&file_of(&texture))?.into_light()?;
//! let pixels = Renderer::new(&texture).render(&capture.views[0].camera);
//! assert_eq!(pixels.len(), 24 * 24);
//! # Ok(())
//! # }
//! ```
//!
//! # Put the maps of a material together
//!
//! `texfold compress walls/ --as material --bpp 5 --mips --out out` takes `wall_Color.png`, `wall_NormalGL.png`, `wall_Roughness.png`,
//! `wall_Displacement.png` and the like as one texture, `out/wall.txf`, and those of each further material of the folder as another. Each map keeps
//! its size, channels, depth and colour space; all share the bits, which are counted over the texels of the largest. Errors of maps that only
//! modulate light (roughness, metalness, occlusion) count a quarter where errors count as seen; `--weights normal=2,height=0.5` sets other weights.
//! `texfold decompress out/wall.txf --out png` writes the maps again under their names (`chair-leather-color.png` for a
//! map `color` of `chair-leather.txf`).
//!
//! In code a map is an image of the texture, found by its name:
//!
//! ```
//! use texfold::{ColorSpace, Encode, Goal, ImageSet, MapKind, core::metric::decode_image};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let color = texfold_testkit::image("odd_37x61");
//! # let normal = texfold_testkit::image("normal_map").tagged(ColorSpace::Normal, texfold::Alpha::Opaque);
//! let maps = vec![
//!     (MapKind::BaseColor, "wall_Color".to_owned(), color),
//!     (MapKind::Normal, "wall_Normal".to_owned(), normal),
//! ];
//! let texture = Encode::new(&ImageSet::of_maps(maps)?).goal(Goal::Bpp(5.0)).mips(true).run()?;
//! let layout = texture.as_encoded().layout();
//! let normal = layout.map("wall_Normal").ok_or("no such map")?;
//! assert_eq!(layout.pixel_of(normal).color, ColorSpace::Normal);
//! let decoded = decode_image(texture.as_encoded(), normal, 0).ok_or("no such image")?;
//! # assert_eq!(decoded.size().width, 128);
//! # Ok(())
//! # }
//! ```
//!
//! A scene of glTF is packed as a whole: `texfold pack scene.glb --out packed` writes one texture a material and the scene, whose textures name
//! their maps in an extension that FORMAT.md describes; other viewers show small images in their place. `texfold unpack packed/scene.glb --out
//! plain` puts PNG images back.
//!
//! On a GPU each map is a texture of its own, decoded from the same file; those of 16 bits are decoded to floats. In a [cache of
//! tiles](#draw-from-a-cache-of-tiles) each map has a number, in the order of the layout, and only maps of colours become linear light.
//!
//! # Build a zoom stack
//!
//! A zoom stack is one image of a whole surface and close-ups of parts of it. A folder of photographs is put in order
//! by itself with `--as zoom`; a `zipmap.toml` in it gives the places by hand, and `tau` (how fast a
//! close-up fades in from its border: 0.001 to 100, 0.5 by default) and `merge` (whether its colours are fitted to its
//! parent's). Root and patches are stored by block, or with `--access texel` in planes that are drawn as they are:
//!
//! ```sh
//! texfold compress photos/wall --as zoom --out packed
//! texfold render packed/wall.txf --zoom-to 0.4,0.6 --steps 12 --out frames
//! ```
//!
//! ```
//! use texfold::{AnyImage, Job, core::Encoder, zipmap::{PatchSource, PatchStack, ZipParams, Zipmap}};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let (root, close_up) = (texfold_testkit::image("odd_37x61"), texfold_testkit::image("cutout"));
//! // From the root's texture coordinates to the patch's: the patch covers the middle third.
//! let matrix = glam::DMat3::from_cols_array(&[3.0, 0.0, 0.0, 0.0, 3.0, 0.0, -1.0, -1.0, 1.0]);
//! let patch = PatchSource { image: 0, matrix, mask: None, parent: None };
//! let stack = PatchStack { root, images: vec![close_up], patches: vec![patch] };
//! let texture = AnyImage::new(Zipmap::encode(&stack, &ZipParams::default(), &mut Job::default())?);
//! assert_eq!(texture.as_encoded().layout().images.len(), 1);
//! # Ok(())
//! # }
//! ```
//!
//! # Share codebooks in a bank
//!
//! A bank is a folder of large images in tiles; images are added to it over time, and none that is there changes. Tiles of codec
//! `dct` are better at any number of bits; those of codec `progressive` are read texel by texel and share codebooks by category:
//!
//! ```sh
//! texfold bank add photos/2024 --codec progressive --category forest --bpp 0.5 --out bank
//! texfold bank add photos/2025 --codec progressive --category forest --bpp 0.5 --out bank
//! texfold bank list bank
//! texfold bank extract bank --image oak --tile 0,1 --out check
//! texfold bank extract bank --image oak --level 1 --region 900,40,300,200 --out check
//! ```
//!
//! In code, a [`Bank`](crate::bank::Bank) lists what is there, decodes rectangles of any level across tiles, and opens single tiles; [levels](crate::bank::Image::levels) of an image are those of its
//! tiles, side by side.
//!
//! A [`BankWriter`](crate::bank::BankWriter) adds images by block, whose tiles share a step ([`Dct::encode_at_step`](crate::dct::Dct::encode_at_step)), and by texel, whose tiles use
//! and grow the public codebooks of their categories. The files are those of `texfold bank add`:
//!
//! ```
//! use texfold::bank::{BankWriter, NewImage};
//! use texfold::{Effort, EncodeSettings, Goal, Job, progressive::Progressive};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let folder = folder.path();
//! let settings = EncodeSettings { goal: Goal::Bpp(0.6), effort: Effort::Fast, ..EncodeSettings::default() };
//! let mut bank: BankWriter = BankWriter::open(folder)?;
//! for name in ["odd_37x61", "odd_3x5"] {
//! #   let raster = texfold_testkit::image(name);
//!     let image = NewImage { name, key: "2026", category: Some("forest"), ..NewImage::default() };
//!     bank.add_texels(&image, &raster, &settings.params::<Progressive>(), &mut Job::default())?;
//! }
//! assert_eq!(bank.bank().images().len(), 2);
//! # Ok(())
//! # }
//! ```
//!
//! Images that no single process holds are added by the parts of it: [`search_blocks`](crate::bank::search_blocks), [`block_tile`](crate::bank::block_tile),
//! [`BankWriter::list_blocks`](crate::bank::BankWriter::list_blocks).
//!
//! # Draw from a cache of tiles
//!
//! `texfold_gpu::TileCache` holds the compressed streams of all textures and a pool of decoded tiles of 128 texels a side. A renderer takes it in
//! at four places:
//!
//! 1. *Once*: `TileCache::new(&gpu, &options)` on a device with seven storage buffers a shader stage. `pool_bytes` is what the view needs: a tile has 64 kB
//!    and covers 120 x 120 pixels at best, so that 1920 x 1080 pixels with overlaps and mip levels take about 32 MB, with reserve 64.
//!    `stream_bytes` holds all textures, in several buffers where one binding of the device (128 MiB by WebGPU's defaults) does not.
//! 2. *For each texture*: `cache.add` returns a number for each image, which the renderer stores with its materials; `remove` frees it;
//!    `replace` takes a file of which more has arrived.
//! 3. *In the shader*: `cache.wgsl(group)` before the renderer's own text, `cache.bind_group()` bound there, and
//!    `texfold_tile_sample(number, uv)` in uniform control flow; `_grad` and `_level` in any.
//! 4. *Each frame*: `cache.update(&mut encoder)` behind the passes that draw.
//!
//! Lookups mark tiles; the update decodes those that are missing, the coarsest first and 64 at most, into the places that were not looked at for longest. A
//! tile that is missing shows the nearest coarser one. Where the pool is too small, lookups add a mip bias until it suffices;
//! `TileCache::report` has its value. A tile of one or two levels below a stored stage (levels 1, 2, 4, 5, ...) is the mean of 4 or 16 times as
//! many samples, which are decoded for it: `scratch_bytes` bounds how many of these an update takes.
//!
//! After the device is lost, make a new one, a new cache, and add all textures again. Textures that are not in superblocks (`bc`,
//! `vq`, `epitome`, `progressive`) are uploaded whole, and the cache draws their tiles from that: it adds hardware filtering and one binding for all, and
//! takes no memory away. The parts of a light field are not drawn through it.
//!
//! Data sets that are larger than memory are read as they are looked at. `cache.add_coarse` holds the smallest levels of a texture alone, as the first bytes of its file give
//! them ([`Bank::coarse_tile`](crate::bank::Bank::coarse_tile), [`Arriving`](crate::Arriving)); `cache.watch` tells, some frames later and without a wait, which textures were looked at, how
//! finely and when; `cache.replace` brings one whole, and `cache.make_coarse` lets go of one. `crates/gpu/examples/bank.rs` flies over a [bank](crate::bank) of any size in
//! 4 MB of streams.
//!
//! # Sequences, and what matters in them
//!
//! Frames of one animation share content, and codec `vq` gives them one codebook; an index map for each frame says which of its 4x4
//! blocks stand where. A folder is a set of images, with `--as sequence` their order is that of time (an animated GIF, WebP or PNG is one by
//! itself), and errors of all frames count alike:
//!
//! ```sh
//! texfold compress flame/ --as sequence --codec vq --bpp 2.5 --out packed
//! texfold compress flame/ --as sequence --out packed    # whichever codec answers the goal best; the verdict gives vq's figures, too
//! ```
//!
//! Further frames join a file without changing a texel of those that are there: blocks that the codebook has already take its codewords, others
//! fill its free rows. A codebook has at most 256 x 256 texels; a smaller one for the first frames leaves room:
//!
//! ```sh
//! texfold compress flame/ --as sequence --codec vq --codebook 256x128 --out packed
//! texfold compress more/ --as sequence --add-to packed/flame.txf --out grown
//! ```
//!
//! For single images vq gives most bits to what matters: what the eye is drawn to, what a mesh stretches (`--mesh`), what a person has
//! painted bright (`--importance-map`). `--importance` says how much that counts against the image as a whole, `--weights` which of the terms
//! decide; `info` writes their maps:
//!
//! ```sh
//! texfold compress face.png --codec vq --bpp 2 --mesh head.obj --importance-map eyes.png --weights saliency=0,painted=4 --out packed
//! texfold info packed/face.txf --pictures parts --original face.png --mesh head.obj   # face-saliency.png, face-distortion.png
//! ```
//!
//! ```
//! use texfold::{ImageSet, Job, core::{Encoder, Growable}, vq::{GuidanceWeights, Vq, VqParams, VqSource}};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let frames = vec![texfold_testkit::image("odd_37x61"); 2];
//! let set = ImageSet::new(frames)?;
//! let weights = GuidanceWeights { saliency: 0.0, ..GuidanceWeights::default() };
//! let params = VqParams::default().with_codebook((128, 128)).with_weights(weights);
//! let mut texture = Vq::encode(VqSource::new(&set), &params, &mut Job::default())?;
//! # let further = ImageSet::single(texfold_testkit::image("odd_37x61"));
//! Vq::add(&mut texture, VqSource::new(&further), &mut Job::default())?;
//! # Ok(())
//! # }
//! ```
