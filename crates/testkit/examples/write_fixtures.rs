//! Writes the fixture images into the workspace's `fixtures` folder.

use std::path::Path;

fn main() -> std::io::Result<()> {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures");
    println!("{} files written", texfold_testkit::fixtures::write_all(&dir)?.len());
    Ok(())
}
