//! Figures of one image in one case: from reports, to and from CSV, and against their references.

use std::fmt;
use std::io::{self, Error};
use std::path::Path;

/// PSNR in dB that may be lost. Orders of sums and libraries of other versions move figures by a thousandth; a loss of 0.02 dB that
/// nobody notices ten times is one that everybody sees.
pub(super) const LESS_DB: f64 = 0.02;
/// Share of its bits by which a file or its GPU form may grow: less than any setting of a codec is apart from the next.
pub(super) const MORE_BITS: f64 = 0.005;
/// Bits by which it may grow as well: small files are mostly their headers and notes, whose words may change.
const MORE_BITS_AT_LEAST: u64 = 1024;

/// The first line of a reference.
const HEAD: &str = "case,image,psnr,psnr_alpha,bits_memory,bits_disk";

/// What is known of one image in one case.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Figures {
    /// The case's name.
    pub(super) case: String,
    /// The input's file name.
    pub(super) image: String,
    /// PSNR in dB; infinite where nothing is lost.
    pub(super) psnr: f64,
    /// That of alpha, where there is any.
    pub(super) psnr_alpha: Option<f64>,
    /// Of the GPU form.
    pub(super) bits_memory: u64,
    /// Of the file.
    pub(super) bits_disk: u64,
}

/// A reference that was missed.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Fault {
    case: String,
    image: String,
    what: What,
}

#[derive(Debug, Clone, PartialEq)]
enum What {
    /// There is no such image or case any more.
    Gone,
    /// Nothing to compare with.
    New,
    /// Of colours or of alpha, before and now.
    Psnr(&'static str, f64, f64),
    /// Of memory or of the file, before and now.
    Bits(&'static str, u64, u64),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}: ", self.case, self.image)?;
        match &self.what {
            What::Gone => {
                write!(f, "has a reference, but was not measured; run cargo xtask reference --write")
            }
            What::New => write!(f, "has no reference; run cargo xtask reference --write"),
            What::Psnr(name, before, now) => write!(f, "{name} is {now:.3} dB, its reference {before:.3}"),
            What::Bits(name, before, now) => write!(f, "{name} takes {now} bits, its reference {before}"),
        }
    }
}

/// The figures of a report of `compress`; an input that failed is an error.
pub(super) fn from_report(case: &str, report: &str) -> io::Result<Vec<Figures>> {
    let rows: Vec<serde_json::Value> = serde_json::from_str(report).map_err(Error::other)?;
    let figures = |row: &serde_json::Value| {
        let input = row["input"].as_str().unwrap_or_default();
        let image = Path::new(input).file_name().unwrap_or_default().to_string_lossy().into_owned();
        let bits = |name: &str| {
            let missing = || format!("case {case}, {image}: {}", row["error"].as_str().unwrap_or(name));
            row[name].as_u64().ok_or_else(|| Error::other(missing()))
        };
        Ok(Figures {
            case: case.to_owned(),
            psnr: row["psnr"].as_f64().unwrap_or(f64::INFINITY),
            psnr_alpha: row.get("psnr_alpha").map(|psnr| psnr.as_f64().unwrap_or(f64::INFINITY)),
            bits_memory: bits("bits_memory")?,
            bits_disk: bits("bits_disk")?,
            image,
        })
    };
    rows.iter().map(figures).collect()
}

/// As CSV, in order of cases and images.
pub(super) fn csv(all: &[Figures]) -> String {
    let mut sorted: Vec<&Figures> = all.iter().collect();
    sorted.sort_by(|a, b| (&a.case, &a.image).cmp(&(&b.case, &b.image)));
    let line = |one: &Figures| {
        let alpha = one.psnr_alpha.map_or(String::new(), |psnr| format!("{psnr:.3}"));
        let Figures { case, image, psnr, bits_memory, bits_disk, .. } = one;
        format!("{case},{image},{psnr:.3},{alpha},{bits_memory},{bits_disk}\n")
    };
    format!("{HEAD}\n{}", sorted.into_iter().map(line).collect::<String>())
}

/// From CSV.
pub(super) fn parse(text: &str) -> io::Result<Vec<Figures>> {
    let mut lines = text.lines();
    if lines.next() != Some(HEAD) {
        return Err(Error::other("a reference of other columns; run cargo xtask reference --write"));
    }
    let figures = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        let &[case, image, psnr, alpha, memory, disk] = &fields[..] else { return None };
        Some(Figures {
            case: case.to_owned(),
            image: image.to_owned(),
            psnr: psnr.parse().ok()?,
            psnr_alpha: if alpha.is_empty() { None } else { Some(alpha.parse().ok()?) },
            bits_memory: memory.parse().ok()?,
            bits_disk: disk.parse().ok()?,
        })
    };
    let wrong = |line: &str| Error::other(format!("'{line}' is no line of a reference"));
    lines.map(|line| figures(line).ok_or_else(|| wrong(line))).collect()
}

/// What is worse than its reference, or has no counterpart.
pub(super) fn compare(kept: &[Figures], found: &[Figures]) -> Vec<Fault> {
    let is_same = |a: &Figures, b: &Figures| a.case == b.case && a.image == b.image;
    let fault = |of: &Figures, what| Fault { case: of.case.clone(), image: of.image.clone(), what };
    let gone = kept.iter().filter(|old| !found.iter().any(|new| is_same(old, new)));
    let mut faults: Vec<Fault> = gone.map(|old| fault(old, What::Gone)).collect();
    for new in found {
        match kept.iter().find(|old| is_same(old, new)) {
            None => faults.push(fault(new, What::New)),
            Some(old) => faults.extend(worse(old, new).into_iter().map(|what| fault(new, what))),
        }
    }
    faults
}

fn worse(old: &Figures, new: &Figures) -> Vec<What> {
    let mut worse = Vec::new();
    let alphas = [old, new].map(|figures| figures.psnr_alpha.unwrap_or(f64::INFINITY));
    for (name, before, now) in [("PSNR", old.psnr, new.psnr), ("PSNR of alpha", alphas[0], alphas[1])] {
        // References are rounded to a thousandth.
        if now < before - LESS_DB {
            worse.push(What::Psnr(name, before, now));
        }
    }
    for (name, before, now) in
        [("memory", old.bits_memory, new.bits_memory), ("the file", old.bits_disk, new.bits_disk)]
    {
        if now as f64 > before as f64 * (1.0 + MORE_BITS) + MORE_BITS_AT_LEAST as f64 {
            worse.push(What::Bits(name, before, now));
        }
    }
    worse
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures(image: &str) -> Figures {
        Figures {
            case: "vq --bpp 2".into(),
            image: image.into(),
            psnr: 31.25,
            psnr_alpha: None,
            bits_memory: 100_000,
            bits_disk: 80_000,
        }
    }

    #[test]
    fn figures_survive_csv() {
        let exact = Figures { psnr: f64::INFINITY, psnr_alpha: Some(40.5), ..figures("a.png") };
        let all = [exact, figures("b.png")];
        assert_eq!(parse(&csv(&all)).unwrap(), all);
        assert!(parse("case\n").is_err() && parse(&format!("{HEAD}\na,b,c\n")).is_err());
    }

    #[test]
    fn only_what_is_worse_is_named() {
        let kept = [figures("a.png"), figures("b.png")];
        let of = |change: fn(&mut Figures)| {
            let mut found = kept.clone();
            change(&mut found[1]);
            compare(&kept, &found).iter().map(Fault::to_string).collect::<Vec<_>>()
        };
        assert!(of(|_| {}).is_empty());
        assert!(of(|b| b.psnr -= 0.019).is_empty() && of(|b| b.psnr += 5.0).is_empty());
        assert!(of(|b| b.bits_disk += 1400).is_empty() && of(|b| b.bits_memory -= 50_000).is_empty());
        assert_eq!(of(|b| b.psnr -= 0.03), ["vq --bpp 2, b.png: PSNR is 31.220 dB, its reference 31.250"]);
        assert!(of(|b| b.psnr_alpha = Some(30.0))[0].contains("PSNR of alpha"));
        assert!(of(|b| b.bits_disk += 1500)[0].contains("the file takes 81500 bits"));
        assert!(of(|b| b.bits_memory += 1600)[0].contains("memory"));
        let renamed = of(|b| b.image = "c.png".into());
        assert!(renamed[0].contains("was not measured") && renamed[1].contains("has no reference"));
    }

    #[test]
    fn reports_are_read_and_failures_named() {
        let report = r#"[{"input": "x/a.png", "psnr": null, "bits_memory": 8, "bits_disk": 9}]"#;
        let found = from_report("bc", report).unwrap();
        assert_eq!((&found[0].image[..], found[0].psnr, found[0].bits_disk), ("a.png", f64::INFINITY, 9));
        let failed = from_report("bc", r#"[{"input": "x/a.png", "error": "no image"}]"#).unwrap_err();
        assert_eq!(failed.to_string(), "case bc, a.png: no image");
    }
}
