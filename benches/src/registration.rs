//! Registration: how many of 200 pairs that show the same are taken, where they are put, and how many of 200 pairs that do not
//! are taken too.
//!
//! `cargo run --release -p texfold-benches --bin registration -- [OUT] [--half 0|1] [--kind WORD] [--times N]`. Pairs are made of
//! the images of `TEXFOLD_DATA`, of the fixtures where there are none. The first half of the images, `--half 0`, is for
//! tuning: groups of images that show one thing, by name, of which every second belongs to it. With `OUT` the pairs are
//! written there, and the table as `OUT/registration.md`; where `OUT/oracle.csv` lies, as `benches/registration.py OUT`
//! makes it, the table has its figures too.

#[path = "registration/pairs.rs"]
mod pairs;
#[path = "registration/picture.rs"]
mod picture;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec2};
use texfold::{
    Job,
    zipmap::{Fault, LeftOut, register},
};
use texfold_benches::report::{Outcome, Table, cpu_seconds};

use pairs::{EACH, EACH_FALSE, FALSE, Kind, Pair, TRUE};
use picture::moved;

/// Error of a corner beyond which a pair is in a wrong place, in pixels of the coarser photograph.
const WRONG: f64 = 5.0;

/// What a run is to do.
#[derive(Debug, Default)]
struct Request {
    out: Option<PathBuf>,
    half: Option<usize>,
    kind: String,
    /// Times as many pairs.
    times: usize,
}

/// What became of a pair.
#[derive(Debug, Clone)]
struct Found {
    kind: Kind,
    half: usize,
    /// Largest distance of the corners of what both show, in pixels of the finer photograph and of the coarser one.
    errors: Option<(f64, f64)>,
    /// Why it is not taken; empty where it is.
    refused: String,
    seconds: f64,
}

fn main() -> Outcome<()> {
    let request = request()?;
    let data = texfold_testkit::data_dir("pairs of real images");
    let sources = pairs::sources(&data.unwrap_or_else(texfold_testkit::fixtures_dir))?;
    if let Some(out) = &request.out {
        std::fs::create_dir_all(out)?;
        std::fs::write(out.join("truth.csv"), "name,kind,half,matrix\n")?;
    }
    let oracle = request.out.as_deref().map(read_oracle).unwrap_or_default();
    let (mut found, mut of_oracle) = (Vec::new(), Vec::new());
    let kinds = TRUE.iter().map(|&kind| (kind, EACH)).chain(FALSE.iter().map(|&kind| (kind, EACH_FALSE)));
    for (kind, count) in kinds.filter(|(kind, _)| kind.name().contains(&request.kind)) {
        for number in
            (0..count * request.times).filter(|number| request.half.is_none_or(|half| number % 2 == half))
        {
            let Some(pair) = pairs::pair(&sources, kind, number)? else {
                println!("{}: no pair {number} can be made", kind.name());
                continue;
            };
            let name = format!("{}_{number:02}", format!("{kind:?}").to_lowercase());
            let result = registered(&pair, number % 2)?;
            println!(
                "{name}, {}, {}, zoom {:.2}, overlap {:.2}, {:.2?}, {}, {:.2} s",
                pair.names[0],
                pair.names[1],
                pair.zoom,
                pair.overlap,
                result.errors,
                result.refused,
                result.seconds
            );
            if let Some(out) = &request.out {
                write(out, &name, &pair, number % 2)?;
            }
            if let Some(matrix) = oracle.get(&name) {
                let errors = matrix.map(|matrix| errors(&pair, &matrix));
                let refused = if errors.is_some() { "" } else { "refused" }.to_owned();
                of_oracle.push(Found { errors, refused, seconds: 0.0, ..result.clone() });
            }
            found.push(result);
        }
    }
    let table = tabled(&found, &of_oracle);
    if let Some(out) = &request.out {
        table.write(
            out,
            "registration",
            "Errors are those of the worst corner, in pixels of the finer photograph.",
        )?;
    }
    Ok(())
}

fn request() -> Outcome<Request> {
    let mut request = Request { times: 1, ..Request::default() };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        match word.as_str() {
            "--half" => request.half = Some(words.next().ok_or("--half needs 0 or 1")?.parse()?),
            "--times" => request.times = words.next().ok_or("--times needs a number")?.parse()?,
            "--kind" => request.kind = words.next().ok_or("--kind needs a word")?,
            _ => request.out = Some(word.into()),
        }
    }
    Ok(request)
}

fn registered(pair: &Pair, half: usize) -> Outcome<Found> {
    let photos = [pair.photos[0].raster()?, pair.photos[1].raster()?];
    let start = cpu_seconds();
    let registration = register(&photos, &mut Job::default())?;
    let seconds = cpu_seconds() - start;
    let link = registration.links.first();
    let matrix = link.map(|link| if link.coarse == 0 { link.matrix } else { link.matrix.inverse() });
    let refused = match (link, registration.left_out.first()) {
        (None, Some((_, LeftOut::Alone { fault, inliers }))) => {
            let reason = match fault {
                Fault::NoFit => "no homography",
                Fault::FewInliers { .. } => "few agree",
                Fault::Cluster { .. } => "cluster",
                Fault::Ambiguous => "ambiguous",
                Fault::Pixels { .. } => "pixels",
                _ => "another reason",
            };
            println!("    {inliers} points, {fault}");
            reason.to_owned()
        }
        (None, Some((_, LeftOut::Blank { .. }))) => "blank".to_owned(),
        (None, _) => "another reason".to_owned(),
        (Some(link), _) => {
            println!("    {} points, {:?}", link.inliers, link.agreement);
            String::new()
        }
    };
    Ok(Found { kind: pair.kind, half, errors: matrix.map(|matrix| errors(pair, &matrix)), refused, seconds })
}

/// Distances of a matrix from the truth; 0 where there is none.
fn errors(pair: &Pair, matrix: &DMat3) -> (f64, f64) {
    let Some(truth) = pair.truth else { return (0.0, 0.0) };
    let (first, second) = (pair.photos[0].extent(), pair.photos[1].extent());
    let within = |place: DVec2, extent: DVec2| place.cmpge(DVec2::ZERO).all() && place.cmple(extent).all();
    const GRID: usize = 40;
    let places =
        (0..=GRID * GRID).map(|k| DVec2::new((k % GRID) as f64, (k / GRID) as f64) / (GRID - 1) as f64);
    let shared =
        places.map(|place| place * second).filter(|place| within(moved(&truth.inverse(), *place), first));
    let back = *matrix * truth.inverse();
    let fine = shared.map(|place| (moved(&back, place) - place).length()).fold(0.0, f64::max);
    (fine, fine / pair.zoom.max(1.0))
}

fn write(out: &Path, name: &str, pair: &Pair, half: usize) -> Outcome<()> {
    use std::io::Write;
    pair.photos[0].save(&out.join(format!("{name}_a.png")))?;
    pair.photos[1].save(&out.join(format!("{name}_b.png")))?;
    let numbers =
        pair.truth.map(|truth| truth.transpose().to_cols_array().map(|value| value.to_string()).join(" "));
    let mut file = std::fs::OpenOptions::new().append(true).open(out.join("truth.csv"))?;
    writeln!(file, "{name},{},{half},{}", pair.kind.name(), numbers.unwrap_or_default())?;
    Ok(())
}

/// What another method found: nine numbers, row by row, or none.
fn read_oracle(out: &Path) -> HashMap<String, Option<DMat3>> {
    let text = std::fs::read_to_string(out.join("oracle.csv")).unwrap_or_default();
    let line = |line: &str| {
        let (name, numbers) = line.split_once(',')?;
        let numbers: Vec<f64> = numbers.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        let matrix = <[f64; 9]>::try_from(numbers).ok().map(|rows| DMat3::from_cols_array(&rows).transpose());
        Some((name.to_owned(), matrix))
    };
    text.lines().filter_map(line).collect()
}

fn tabled(found: &[Found], oracle: &[Found]) -> Table {
    let columns = [
        "pairs",
        "half",
        "of",
        "taken",
        "refused",
        "in a wrong place",
        "median",
        "95 %",
        "CPU s a pair",
        "SIFT and MAGSAC",
    ];
    let mut table = Table::new(&columns);
    for half in 0..2 {
        for &kind in TRUE.iter().chain(&FALSE) {
            row(&mut table, kind.name(), half, found, oracle, |one| one.kind == kind);
        }
        row(&mut table, "all true ones", half, found, oracle, |one| TRUE.contains(&one.kind));
        row(&mut table, "all false ones", half, found, oracle, |one| FALSE.contains(&one.kind));
    }
    table
}

fn row(
    table: &mut Table,
    name: &str,
    half: usize,
    found: &[Found],
    oracle: &[Found],
    wanted: impl Fn(&Found) -> bool,
) {
    let pick = |all: &[Found]| -> Vec<Found> {
        all.iter().filter(|one| one.half == half && wanted(one)).cloned().collect()
    };
    let own = pick(found);
    if own.is_empty() {
        return;
    }
    let (taken, wrong, median, most) = counted(&own);
    let mut reasons: Vec<(&str, usize)> = Vec::new();
    for one in own.iter().filter(|one| !one.refused.is_empty()) {
        match reasons.iter_mut().find(|(reason, _)| *reason == one.refused) {
            Some((_, count)) => *count += 1,
            None => reasons.push((&one.refused, 1)),
        }
    }
    let reasons: Vec<String> = reasons.iter().map(|(reason, count)| format!("{reason} {count}")).collect();
    let seconds = own.iter().map(|one| one.seconds).sum::<f64>() / own.len() as f64;
    let other = pick(oracle);
    let other = if other.is_empty() {
        "not measured".to_owned()
    } else {
        let (taken, wrong, median, most) = counted(&other);
        format!("{taken} taken, {wrong} wrong, {median:.2} and {most:.2}")
    };
    let refused = if reasons.is_empty() { "0".to_owned() } else { reasons.join("; ") };
    table.row(vec![
        name.to_owned(),
        ["tuned", "held back"][half].to_owned(),
        own.len().to_string(),
        taken.to_string(),
        refused,
        wrong.to_string(),
        format!("{median:.2}"),
        format!("{most:.2}"),
        format!("{seconds:.2}"),
        other,
    ]);
}

/// How many are taken, how many of them in a wrong place, and median and 95 % of the errors of the others.
fn counted(found: &[Found]) -> (usize, usize, f64, f64) {
    let errors: Vec<(f64, f64)> = found.iter().filter_map(|one| one.errors).collect();
    let wrong = errors.iter().filter(|(_, coarse)| *coarse > WRONG || coarse.is_nan()).count();
    let mut right: Vec<f64> =
        errors.iter().filter(|(_, coarse)| *coarse <= WRONG).map(|(fine, _)| *fine).collect();
    right.sort_by(f64::total_cmp);
    let at = |share: f64| {
        right.get((share * right.len() as f64) as usize).or(right.last()).copied().unwrap_or(0.0)
    };
    (errors.len(), wrong, at(0.5), at(0.95))
}
