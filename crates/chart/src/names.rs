//! Where the names of points go, so that they cover neither each other nor the points.
//!
//! Greedy: each name takes the first of a few places around its point that is free. Cost: names times names.
//! *Not done*: moving names that were placed before; a chart here has some 20.

/// Size of the letters in SVG units.
pub(crate) const FONT: i32 = 13;

/// Mean width of a letter, from above.
const LETTER: i32 = 7;
/// Distance between a point's centre and its name.
const GAP: i32 = 8;
/// Half of the side of the square that a point takes.
const DOT: i32 = 5;

#[derive(Debug, Clone, Copy)]
struct Area {
    left: i32,
    top: i32,
    right: i32,
    bottom: i32,
}

impl Area {
    fn meets(&self, other: &Area) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }
}

/// Upper left corners of the names of points, in the same order, right of `left_end` and above `bottom_end` where there is room;
/// `below` where a line rises through the points, so that names stand under it.
pub(crate) fn place(
    points: &[(i32, i32)],
    names: &[&str],
    below: bool,
    (left_end, bottom_end): (i32, i32),
) -> Vec<(i32, i32)> {
    let dot = |&(x, y): &(i32, i32)| Area { left: x - DOT, top: y - DOT, right: x + DOT, bottom: y + DOT };
    let mut taken: Vec<Area> = points.iter().map(dot).collect();
    let mut corners = Vec::new();
    for (&(x, y), name) in points.iter().zip(names) {
        let width = LETTER * name.chars().count() as i32;
        let area = |(left, top): (i32, i32)| Area { left, top, right: left + width, bottom: top + FONT };
        let sides = [x + GAP, x - GAP - width];
        let over = [-FONT - 3, -2 * FONT - 3, -3 * FONT - 3];
        let under = [2, FONT + 2, 2 * FONT + 2];
        let rows = if below { [under, over] } else { [over, under] };
        let rows: Vec<i32> = rows.into_iter().flatten().map(|row| y + row).collect();
        let mut places = rows.iter().flat_map(|&top| sides.map(|left| (left, top)));
        let free = places.find(|&corner| {
            let area = area(corner);
            let is_inside = area.left >= left_end && area.bottom <= bottom_end;
            is_inside && !taken.iter().any(|other| other.meets(&area))
        });
        let corner = free.unwrap_or((sides[0], rows[0]));
        taken.push(area(corner));
        corners.push(corner);
    }
    corners
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_points_at_one_place_do_not_meet() {
        let points = [(100, 100), (101, 100), (100, 102), (300, 100)];
        let names = ["256x256 bc7", "2.5 bpp", "256x128 bc7", "bc1"];
        let corners = place(&points, &names, true, (0, 500));
        assert_eq!(corners[3], (308, 102));
        let width = |index: usize| LETTER * names[index].len() as i32;
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            let (left, right) = if corners[a].0 < corners[b].0 { (a, b) } else { (b, a) };
            let apart = corners[left].0 + width(left) <= corners[right].0;
            assert!(apart || (corners[a].1 - corners[b].1).abs() >= FONT, "{corners:?}");
        }
    }
}
