//! `view --serve`: the page from a server on loopback, which also encodes the images that the page sends.

use std::collections::{BTreeMap, HashMap};
use std::io::Read;
use std::path::Path;

use clap::Parser;
use serde_json::{Value, json};
use tiny_http::{Header, Method, Request, Response, Server};

use super::{Item, item, page};
use crate::CompressArgs;
use crate::compress;
use crate::console::{self, complain};
use crate::error::{CliError, explain};
use crate::memory::MemoryArgs;

/// Largest image file that is taken, in bytes.
const MOST_BYTES: u64 = 1 << 30;
/// A header that only the page's own script can set: other pages that the browser shows cannot have images encoded.
const OWN_HEADER: &str = "X-Texfold";
/// Options of `compress` that the page may set.
const OPTIONS: [&str; 5] = ["bpp", "psnr", "codec", "effort", "metric"];

type Reply = Response<std::io::Cursor<Vec<u8>>>;

/// `compress`, as a command line of its own.
#[derive(Debug, Parser)]
struct Compress {
    #[command(flatten)]
    args: CompressArgs,
}

/// Serves until the process ends.
pub(super) fn serve(port: u16, items: &[Item]) -> Result<usize, CliError> {
    let fault = |source: Box<dyn std::error::Error + Send + Sync>| CliError::Serve { port, source };
    let server = Server::http(("127.0.0.1", port)).map_err(fault)?;
    let address = server.server_addr().to_string();
    let page = page(items, &BTreeMap::new(), true);
    console::answer(&format!("http://{address}/"));
    for mut request in server.incoming_requests() {
        let reply = answer(&mut request, &address, (&page, items));
        if let Err(error) = request.respond(reply) {
            complain(&format!("an answer could not be sent: {error}"));
        }
    }
    Ok(0)
}

fn answer(request: &mut Request, address: &str, (page, items): (&str, &[Item])) -> Reply {
    let header = |name: &'static str| {
        let found = request.headers().iter().find(|header| header.field.equiv(name));
        found.map(|header| header.value.as_str().to_owned())
    };
    // A name that leads here by way of another site's DNS is refused.
    let host = header("Host").unwrap_or_default();
    let local = address.rsplit(':').next().map(|port| format!("localhost:{port}"));
    if host != address && Some(&host) != local.as_ref() {
        return text(403, "text/plain", format!("open http://{address}/"));
    }
    let url = request.url().to_owned();
    let (path, query) = url.split_once('?').unwrap_or((&url, ""));
    match (request.method(), path) {
        (Method::Get, "/") => text(200, "text/html; charset=utf-8", page.to_owned()),
        (Method::Get, path) if path.starts_with("/bank/") => tile(&path["/bank/".len()..], items),
        (Method::Post, "/encode") if header(OWN_HEADER).is_some() => match encode(request, query) {
            Ok(found) => text(200, "application/json", found.to_string()),
            Err(error) => text(422, "text/plain; charset=utf-8", error),
        },
        _ => text(404, "text/plain", "not found; open /".to_owned()),
    }
}

/// A tile of a bank, at `NUMBER/FILE`: number of the item, name of the tile's file.
fn tile(place: &str, items: &[Item]) -> Reply {
    let path = place.split_once('/').and_then(|(number, file)| {
        let bank = items.get(number.parse::<usize>().ok()?)?.bank.as_ref()?;
        bank.tile(&decoded(file))
    });
    let Some(path) = path else { return text(404, "text/plain", "no such tile; load the page again") };
    match std::fs::read(&path) {
        Ok(bytes) => text(200, "application/octet-stream", bytes),
        Err(error) => {
            complain(&format!("{}: the tile cannot be read: {error}", path.display()));
            text(500, "text/plain; charset=utf-8", format!("the tile cannot be read: {error}"))
        }
    }
}

fn text(status: u16, kind: &str, body: impl Into<Vec<u8>>) -> Reply {
    let reply = Response::from_data(body).with_status_code(status);
    match Header::from_bytes("Content-Type", kind) {
        Ok(header) => reply.with_header(header),
        Err(()) => reply,
    }
}

/// Encodes the image of a request by the options of its query: the file as the page takes it, and its row of the report.
fn encode(request: &mut Request, query: &str) -> Result<Value, String> {
    let options: HashMap<String, String> = query.split('&').filter_map(option).collect();
    let mut bytes = Vec::new();
    let read = request.as_reader().take(MOST_BYTES + 1).read_to_end(&mut bytes);
    read.map_err(|error| format!("the image did not arrive; send it again: {error}"))?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err("the image has more than 1 GiB; use `texfold compress`".to_owned());
    }
    let dir =
        tempfile::tempdir().map_err(|error| format!("no temporary folder; free some space: {error}"))?;
    compressed(dir.path(), &bytes, &options).map_err(|error| {
        // Images are named as the page names them.
        error.replace(&format!("{}{}", dir.path().display(), std::path::MAIN_SEPARATOR), "")
    })
}

/// Encodes an image in a folder of its own.
fn compressed(dir: &Path, bytes: &[u8], options: &HashMap<String, String>) -> Result<Value, String> {
    let name = options.get("name").map_or("image.png", String::as_str);
    let input = dir.join(Path::new(name).file_name().unwrap_or("image.png".as_ref()));
    std::fs::write(&input, bytes)
        .map_err(|error| format!("the image cannot be kept; free some space: {error}"))?;
    let report = dir.join("report.json");
    let mut line = vec!["compress".into(), input.clone().into_os_string(), "--mips".into()];
    line.extend(["--out".into(), dir.into(), "--report".into(), report.clone().into()]);
    for key in OPTIONS {
        if let Some(value) = options.get(key) {
            line.push(format!("--{key}={value}").into());
        }
    }
    let args = Compress::try_parse_from(line).map_err(|error| error.to_string())?.args;
    let failed = compress::run(args).map_err(|error| explain(&error))?;
    let row = std::fs::read(&report).ok().and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok());
    let row = row.and_then(|rows| rows.get(0).cloned()).unwrap_or_default();
    if failed > 0 {
        return Err(row["error"].as_str().unwrap_or("the image cannot be encoded").to_owned());
    }
    let item = item(&input.with_extension("txf"), Some(&input), MemoryArgs::default())
        .map_err(|error| explain(&error))?;
    Ok(json!({ "item": item, "report": row }))
}

/// A pair of a query, its value without percent signs.
fn option(pair: &str) -> Option<(String, String)> {
    let (key, value) = pair.split_once('=')?;
    Some((key.to_owned(), decoded(value)))
}

/// Text whose bytes may be written as a percent sign and two hexadecimal digits.
fn decoded(text: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = text.as_bytes();
    while let [first, behind @ ..] = rest {
        let digits = behind.get(..2).filter(|_| *first == b'%').and_then(|two| std::str::from_utf8(two).ok());
        let byte = digits.and_then(|two| u8::from_str_radix(two, 16).ok());
        bytes.push(byte.unwrap_or(*first));
        rest = if byte.is_some() { &behind[2..] } else { behind };
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn queries_are_read() {
        assert_eq!(option("name=a%20b%c3%A9%"), Some(("name".to_owned(), "a bé%".to_owned())));
        assert_eq!(option("name"), None);
    }
}
