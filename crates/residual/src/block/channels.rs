//! From axes to the channels of texels.

use super::form::{AXIS_BITS, BlockForm, Group, MAX_GROUP};

/// Most texels along a superblock's side.
const MAX_SIDE: usize = 64;

/// What samples are decoded to.
pub trait BlockSample: Copy + Default + Send + Sync + sealed::Sealed {
    /// The sample of a sum of that many fractional bits, between 0 and the largest one.
    fn of(sum: i32, shift: u32, largest: i32) -> Self;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for u8 {}
    impl Sealed for u16 {}
}

impl BlockSample for u8 {
    #[inline(always)]
    fn of(sum: i32, shift: u32, largest: i32) -> u8 {
        if shift == 16 {
            // What is left has 16 bits, which SSE2 can clamp.
            return ((sum >> 16) as i16).clamp(0, largest as i16) as u8;
        }
        (sum >> shift).clamp(0, largest) as u8
    }
}

impl BlockSample for u16 {
    #[inline(always)]
    fn of(sum: i32, shift: u32, largest: i32) -> u16 {
        (sum >> shift).clamp(0, largest) as u16
    }
}

/// Channels of texels in a row of a superblock, from a place in it on, from its axes.
#[inline(never)]
pub(super) fn write_channels<S: BlockSample>(
    form: &BlockForm,
    samples: &[i32],
    side: usize,
    (column, row): (usize, usize),
    out: &mut [S],
) {
    let channels = form.channels();
    let count = out.len() / channels;
    let (mut axis, shift) = (0, form.fraction() + AXIS_BITS);
    let largest = (1i32 << form.depth) - 1;
    for group in &form.groups {
        let used = usize::from(group.channels);
        let rows: [&[i32]; MAX_GROUP] = std::array::from_fn(|rank| {
            let axis = axis + rank.min(used - 1);
            &samples[(axis * side + row) * side + column..][..count]
        });
        let weighting = Weighting { group, shift, largest };
        let mut planar = [[S::default(); MAX_SIDE]; MAX_GROUP];
        for (channel, plane) in planar[..used].iter_mut().enumerate() {
            weighting.channel(channel, &rows, &mut plane[..count]);
        }
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

/// How the channels of a group follow from its axes.
#[derive(Clone, Copy)]
struct Weighting<'a> {
    group: &'a Group,
    /// Fractional bits of the sums.
    shift: u32,
    /// Largest sample.
    largest: i32,
}

impl Weighting<'_> {
    /// A channel of a row of texels from the group's axes. The loops are what compilers turn into vectors.
    fn channel<S: BlockSample>(&self, channel: usize, rows: &[&[i32]; MAX_GROUP], out: &mut [S]) {
        let weights = self.group.axes[channel].map(i32::from);
        let mean = i32::from(self.group.means[channel]).wrapping_shl(self.shift);
        let mean = mean.wrapping_add(1 << (self.shift - 1));
        let sample = |sum: i32| S::of(sum, self.shift, self.largest);
        let part = |value: &i32, axis: usize| value.wrapping_mul(weights[axis]);
        let [first, second, third, fourth] = *rows;
        match self.group.channels {
            1 => {
                for (out, a) in out.iter_mut().zip(first) {
                    *out = sample(mean.wrapping_add(part(a, 0)));
                }
            }
            2 => {
                for (out, (a, b)) in out.iter_mut().zip(first.iter().zip(second)) {
                    *out = sample(mean.wrapping_add(part(a, 0)).wrapping_add(part(b, 1)));
                }
            }
            3 => {
                for (out, ((a, b), c)) in out.iter_mut().zip(first.iter().zip(second).zip(third)) {
                    let sum = mean.wrapping_add(part(a, 0)).wrapping_add(part(b, 1));
                    *out = sample(sum.wrapping_add(part(c, 2)));
                }
            }
            _ => {
                let axes = first.iter().zip(second).zip(third.iter().zip(fourth));
                for (out, ((a, b), (c, d))) in out.iter_mut().zip(axes) {
                    let sum = mean.wrapping_add(part(a, 0)).wrapping_add(part(b, 1));
                    *out = sample(sum.wrapping_add(part(c, 2)).wrapping_add(part(d, 3)));
                }
            }
        }
    }
}
