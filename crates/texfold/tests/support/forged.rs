//! Files that an attacker may write.

use texfold::core::Budget;
use texfold::core::container::{CodecId, SectionWriter, Sections};
use texfold_core::rng::Rng;

/// The same file with the bytes of one section changed and every checksum made right again, as an attacker would.
pub fn with_changed_section(bytes: &[u8], rng: &mut Rng) -> Option<Vec<u8>> {
    let sections = Sections::parse(bytes, &mut Budget::default()).ok()?;
    let ids: Vec<[u8; 4]> = sections.ids().map(|(id, _)| id).collect();
    let target = ids[rng.index(ids.len())];
    rewritten(bytes, target, |raw| damage(raw, rng))
}

/// The same file with the section `target` as `change` leaves it.
pub fn rewritten(bytes: &[u8], target: [u8; 4], change: impl FnOnce(&mut Vec<u8>)) -> Option<Vec<u8>> {
    let mut budget = Budget::default();
    let sections = Sections::parse(bytes, &mut budget).ok()?;
    let mut writer = SectionWriter::new(CodecId { number: sections.codec(), name: "" });
    let mut change = Some(change);
    for (id, _) in sections.ids() {
        let mut raw = sections.read(id, &mut budget).ok()?;
        if let Some(change) = change.take_if(|_| id == target) {
            change(&mut raw);
        }
        writer.section("", id, &raw);
    }
    Some(writer.finish().bytes)
}

fn damage(raw: &mut Vec<u8>, rng: &mut Rng) {
    for _ in 0..1 + rng.index(3) {
        let at = rng.index(raw.len());
        match rng.index(5) {
            0 if !raw.is_empty() => raw[at] = rng.index(256) as u8,
            1 if !raw.is_empty() => raw[at] = [0, 1, 127, 128, 255][rng.index(5)],
            2 => raw.truncate(at),
            3 => raw.extend([0xff; 7]),
            _ if raw.len() >= at + 4 => raw[at..at + 4].copy_from_slice(&[0xff, 0xff, 0xff, 0x7f]),
            _ => raw.push(0),
        }
    }
}
