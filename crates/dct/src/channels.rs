//! From axes to the channels of texels.

use crate::form::{AXIS_BITS, DctForm, Group, MAX_GROUP};
use crate::vectors::vectorised;

/// Most texels along a superblock's side.
const MAX_SIDE: usize = 64;

/// What samples are decoded to.
pub trait DctSample: Copy + Default + Send + Sync + sealed::Sealed {
    /// The sample of a sum of that many fractional bits, between 0 and the largest one.
    fn of(sum: i32, shift: u32, largest: i32) -> Self;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for u8 {}
    impl Sealed for u16 {}
}

impl DctSample for u8 {
    #[inline(always)]
    fn of(sum: i32, shift: u32, largest: i32) -> u8 {
        if shift == 16 {
            // What is left has 16 bits, which SSE2 can clamp.
            return ((sum >> 16) as i16).clamp(0, largest as i16) as u8;
        }
        (sum >> shift).clamp(0, largest) as u8
    }
}

impl DctSample for u16 {
    #[inline(always)]
    fn of(sum: i32, shift: u32, largest: i32) -> u16 {
        (sum >> shift).clamp(0, largest) as u16
    }
}

/// Channels of texels in a row of a superblock, from a place in it on, from its axes.
#[inline(never)]
pub(super) fn write_channels<S: DctSample>(
    form: &DctForm,
    samples: &[i32],
    side: usize,
    place: (usize, usize),
    out: &mut [S],
) {
    vectorised(
        #[inline(always)]
        move || write_row(form, samples, side, place, out),
    );
}

#[inline(always)]
fn write_row<S: DctSample>(
    form: &DctForm,
    samples: &[i32],
    side: usize,
    (column, row): (usize, usize),
    out: &mut [S],
) {
    let channels = form.channels();
    let count = out.len() / channels;
    let mut axis = 0;
    for group in &form.groups {
        let used = usize::from(group.channels);
        let mut planar = [[S::default(); MAX_SIDE]; MAX_GROUP];
        write_planes(
            form,
            group,
            samples,
            side,
            (axis, column, row),
            planar[..used].iter_mut().map(|plane| &mut plane[..count]),
        );
        if used == 3 && channels == 3 {
            let (texels, _) = out.as_chunks_mut::<3>();
            let [first, second, third, _] = &planar;
            for (texel, ((&a, &b), &c)) in texels.iter_mut().zip(first.iter().zip(second).zip(third)) {
                *texel = [a, b, c];
            }
        } else {
            for (channel, plane) in planar[..used].iter().enumerate() {
                let texels = out[axis + channel..].iter_mut().step_by(channels);
                texels.zip(plane).for_each(|(out, &value)| *out = value);
            }
        }
        axis += used;
    }
}

/// RGBA of 8 bits in a row of a superblock, from a place in it on, from its axes: gray in all three colours, 255 where there is no
/// alpha. There are at most four channels of 8 bits.
#[inline(never)]
pub(super) fn write_rgba(
    form: &DctForm,
    samples: &[i32],
    side: usize,
    (column, row): (usize, usize),
    out: &mut [[u8; 4]],
) {
    vectorised(
        #[inline(always)]
        move || {
            let mut planar = [[u8::MAX; MAX_SIDE]; MAX_GROUP];
            let mut axis = 0;
            for group in &form.groups {
                let used = usize::from(group.channels);
                let planes = planar.iter_mut().skip(axis).take(used).map(|plane| &mut plane[..out.len()]);
                write_planes(form, group, samples, side, (axis, column, row), planes);
                axis += used;
            }
            let [red, green, blue, alpha] = match (form.channels(), &planar) {
                (1, [gray, .., opaque]) => [gray, gray, gray, opaque],
                (2, [gray, alpha, ..]) => [gray, gray, gray, alpha],
                (_, [red, green, blue, alpha]) => [red, green, blue, alpha],
            };
            for ((((out, &red), &green), &blue), &alpha) in
                out.iter_mut().zip(red).zip(green).zip(blue).zip(alpha)
            {
                *out = [red, green, blue, alpha];
            }
        },
    );
}

/// Planes of the channels of a group, of which the first axis, first column and row of a superblock are given.
#[inline(always)]
fn write_planes<'a, S: DctSample + 'a>(
    form: &DctForm,
    group: &Group,
    samples: &[i32],
    side: usize,
    (axis, column, row): (usize, usize, usize),
    planes: impl Iterator<Item = &'a mut [S]>,
) {
    let (used, shift) = (usize::from(group.channels), form.fraction() + AXIS_BITS);
    let weighting = Weighting { group, shift, largest: (1i32 << form.depth) - 1 };
    for (channel, plane) in planes.enumerate() {
        let rows: [&[i32]; MAX_GROUP] = std::array::from_fn(|rank| {
            let axis = axis + rank.min(used - 1);
            &samples[(axis * side + row) * side + column..][..plane.len()]
        });
        weighting.channel(channel, &rows, plane);
    }
}

/// How the channels of a group follow from its axes.
#[derive(Clone, Copy)]
struct Weighting<'a> {
    group: &'a Group,
    /// Fractional bits of the sums.
    shift: u32,
    /// Largest sample.
    largest: i32,
}

/// Texels that are computed side by side.
const LANES: usize = 16;

impl Weighting<'_> {
    /// A channel of a row of texels from the group's axes, of which each row has at least as many samples.
    #[inline(always)]
    fn channel<S: DctSample>(&self, channel: usize, rows: &[&[i32]; MAX_GROUP], out: &mut [S]) {
        match self.group.channels {
            1 => self.weighted::<1, S>(channel, rows, out),
            2 => self.weighted::<2, S>(channel, rows, out),
            3 => self.weighted::<3, S>(channel, rows, out),
            _ => self.weighted::<4, S>(channel, rows, out),
        }
    }

    /// The same from that many axes.
    #[inline(always)]
    fn weighted<const AXES: usize, S: DctSample>(
        &self,
        channel: usize,
        rows: &[&[i32]; MAX_GROUP],
        out: &mut [S],
    ) {
        let weights = self.group.axes[channel].map(i32::from);
        let mean = i32::from(self.group.means[channel]).wrapping_shl(self.shift);
        let mean = mean.wrapping_add(1 << (self.shift - 1));
        let (lanes, rest) = out.as_chunks_mut::<LANES>();
        // Loops over arrays of a fixed length are what compilers turn into vectors.
        for (number, lanes) in lanes.iter_mut().enumerate() {
            let mut sums = [mean; LANES];
            for (row, weight) in rows.iter().zip(weights).take(AXES) {
                let Some(values) = row[LANES * number..].first_chunk::<LANES>() else { continue };
                for (sum, value) in sums.iter_mut().zip(values) {
                    *sum = sum.wrapping_add(value.wrapping_mul(weight));
                }
            }
            for (lane, sum) in lanes.iter_mut().zip(sums) {
                *lane = S::of(sum, self.shift, self.largest);
            }
        }
        let first = LANES * lanes.len();
        for (at, out) in (first..).zip(rest) {
            let part = |(row, weight): (&&[i32], i32)| row[at].wrapping_mul(weight);
            let parts = rows.iter().zip(weights).take(AXES).map(part);
            *out = S::of(parts.fold(mean, i32::wrapping_add), self.shift, self.largest);
        }
    }
}
