//! Blocks, and the squares that may become their leaves.

use glam::{UVec2, Vec4};
use texfold_core::ImageSize;

use super::pyramid::Space;
use crate::format::blocks_of;

/// A block's square, its four quarters, and theirs.
pub(crate) const SPLIT_NODES: usize = crate::format::NODES;

/// A square of an image that may be a leaf.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Node {
    pub(crate) image: usize,
    pub(crate) corner: UVec2,
    pub(crate) side: u32,
    /// Columns and rows inside the image; 0 where there are none.
    pub(crate) inside: UVec2,
}

/// All blocks of all images.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    pub(crate) block: u32,
    pub(crate) split: bool,
    /// Image, column and row of each block.
    blocks: Vec<(usize, u32, u32)>,
    sizes: Vec<ImageSize>,
    /// First block of each image.
    pub(crate) starts: Vec<usize>,
}

impl Grid {
    pub(crate) fn new(sizes: &[ImageSize], block: u32, split: bool) -> Self {
        let mut blocks = Vec::new();
        let mut starts = Vec::new();
        for (image, &size) in sizes.iter().enumerate() {
            let (columns, rows) = blocks_of(size, block);
            starts.push(blocks.len());
            blocks.extend((0..rows).flat_map(|y| (0..columns).map(move |x| (image, x, y))));
        }
        Grid { block, split, blocks, sizes: sizes.to_vec(), starts }
    }

    /// Number of blocks.
    pub(crate) fn blocks(&self) -> usize {
        self.blocks.len()
    }

    /// Nodes of a block.
    pub(crate) fn per_block(&self) -> usize {
        if self.split { SPLIT_NODES } else { 1 }
    }

    /// Number of nodes.
    pub(crate) fn nodes(&self) -> usize {
        self.blocks.len() * self.per_block()
    }

    /// Node `index`: of each block the whole first, then the quarters, then theirs, quarter by quarter.
    pub(crate) fn node(&self, index: usize) -> Node {
        let (image, x, y) = self.blocks[index / self.per_block()];
        let corner = UVec2::new(x, y) * self.block;
        let place = |number: usize| UVec2::new(number as u32 % 2, number as u32 / 2);
        let half = self.block / 2;
        let (corner, side) = match index % self.per_block() {
            0 => (corner, self.block),
            number @ 1..=4 => (corner + place(number - 1) * half, half),
            number => {
                let (quarter, part) = ((number - 5) / 4, (number - 5) % 4);
                (corner + place(quarter) * half + place(part) * (half / 2), half / 2)
            }
        };
        let size = self.sizes[image];
        let inside = UVec2::new(size.width, size.height).saturating_sub(corner).min(UVec2::splat(side));
        let inside = if inside.x == 0 || inside.y == 0 { UVec2::ZERO } else { inside };
        Node { image, corner, side, inside }
    }

    /// The node of the same size at the right, left, below and above, where there is one.
    pub(crate) fn neighbours(&self, index: usize) -> impl Iterator<Item = usize> + '_ {
        let node = self.node(index);
        let steps = [(1i64, 0i64), (-1, 0), (0, 1), (0, -1)];
        steps.into_iter().filter_map(move |(dx, dy)| {
            let x = i64::from(node.corner.x) + dx * i64::from(node.side);
            let y = i64::from(node.corner.y) + dy * i64::from(node.side);
            self.find(node.image, x, y, node.side)
        })
    }

    /// The node of that corner and side.
    pub(crate) fn find(&self, image: usize, x: i64, y: i64, side: u32) -> Option<usize> {
        let size = self.sizes[image];
        if x < 0 || y < 0 || x >= i64::from(size.width) || y >= i64::from(size.height) {
            return None;
        }
        let (x, y) = (x as u32, y as u32);
        let (columns, _) = blocks_of(size, self.block);
        let block = self.starts[image] + (y / self.block * columns + x / self.block) as usize;
        let inner = UVec2::new(x % self.block, y % self.block);
        let half = self.block / 2;
        let number = |at: UVec2| (at.y * 2 + at.x) as usize;
        let quarter = number(inner / half);
        let local = if side == self.block {
            0
        } else if side == half {
            1 + quarter
        } else {
            5 + 4 * quarter + number(inner % half / (half / 2))
        };
        Some(block * self.per_block() + local)
    }
}

impl Node {
    /// The node's own texels inside the image, row by row.
    pub(crate) fn texels(&self, space: &Space) -> Vec<Vec4> {
        let field = &space.pyramids[self.image].source[0];
        let mut texels = Vec::new();
        for y in self.corner.y..self.corner.y + self.inside.y {
            let start = y as usize * field.width + self.corner.x as usize;
            texels.extend(&field.texels[start..start + self.inside.x as usize]);
        }
        texels
    }

    /// Whether it has no texel inside the image.
    pub(crate) fn is_outside(&self) -> bool {
        self.inside.x == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_found_by_their_corner() {
        let sizes = [ImageSize { width: 70, height: 33 }, ImageSize { width: 5, height: 64 }];
        let grid = Grid::new(&sizes, 32, true);
        assert_eq!(grid.blocks(), 3 * 2 + 2);
        for index in 0..grid.nodes() {
            let node = grid.node(index);
            if node.is_outside() {
                continue;
            }
            let found = grid.find(node.image, node.corner.x.into(), node.corner.y.into(), node.side);
            assert_eq!(found, Some(index));
        }
        assert_eq!(grid.neighbours(0).count(), 2);
    }
}
