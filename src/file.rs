//! Files written whole or not at all, and read without panic.

use std::any::Any;
use std::cell::Cell;
use std::collections::HashSet;
use std::fs::File;
use std::io::{Read, Write};
use std::panic::{self, AssertUnwindSafe};
use std::path::{Path, PathBuf};
use std::sync::Once;

use anyhow::{Context, Result, bail, ensure};

use crate::progress::Unfinished;

/// Writes a file under a temporary name beside `path` and renames it once it is whole. Where `path` is a link, the file
/// that it leads to is written. A cancelled process waits for it.
pub fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut std::fs::File) -> Result<()>,
) -> Result<()> {
    let _unfinished = Unfinished::new();
    let attempt = || -> Result<()> {
        let path = &target(path)?;
        // A file would take the place of a device, a pipe or a folder.
        ensure!(path.is_file() || !path.exists(), "something that is no file is there");
        let mut file = tempfile::NamedTempFile::new_in(folder(path))?;
        write(file.as_file_mut())?;
        file.as_file_mut().flush()?;
        // Temporary files are private; a picture is not.
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            file.as_file().set_permissions(std::fs::Permissions::from_mode(0o644))?;
        }
        file.persist(path)?;
        Ok(())
    };
    attempt().with_context(|| format!("{}: cannot be written", path.display()))
}

/// The folder that a file is in.
fn folder(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Where a path leads through symbolic links, to a file that need not be there yet.
fn target(path: &Path) -> Result<PathBuf> {
    // As many as Linux follows.
    const LINKS: usize = 40;
    let mut path = path.to_owned();
    for _ in 0..LINKS {
        match std::fs::read_link(&path) {
            Ok(to) => path = folder(&path).join(to),
            Err(_) => return Ok(path),
        }
    }
    bail!("its symbolic links lead in a circle")
}

/// Checks, before any work is done, that files can be written: their folders are there, and none of them is an input
/// or named twice.
///
/// # Errors
/// One line that names the file.
pub fn check_outputs(outputs: &[&Path], inputs: &[&Path]) -> Result<()> {
    // One file has one such path, whether it is there yet or not.
    let identity = |path: &Path| -> Result<PathBuf> {
        let path = target(path)?;
        Ok(folder(&path).canonicalize()?.join(path.file_name().unwrap_or_default()))
    };
    let inputs: Vec<PathBuf> = inputs.iter().filter_map(|path| identity(path).ok()).collect();
    let mut known = HashSet::new();
    for path in outputs {
        let (name, folder) = (path.display(), folder(path));
        ensure!(
            folder.is_dir(),
            "{name}: cannot be written: the folder {} is not there: make it first",
            folder.display()
        );
        let identity = identity(path).with_context(|| format!("{name}: cannot be written"))?;
        ensure!(
            !inputs.contains(&identity),
            "{name}: is read as an input and would be overwritten: choose another name"
        );
        ensure!(known.insert(identity), "{name}: is written twice: choose another name");
    }
    Ok(())
}

/// The largest picture that is read: 16384 × 8192, 1.5 GiB of RGB floats.
pub const MAX_PIXELS: usize = 16384 * 8192;
/// The largest file that a picture is read from, for the same picture uncompressed with a few more channels.
const MAX_FILE_BYTES: u64 = 4 << 30;
/// No side of a picture is longer: twice the largest map's width leaves room for odd shapes.
const MAX_SIDE: usize = 32768;

/// The bytes of a picture's file.
///
/// # Errors
/// One line without the file's name: it cannot be read, is empty, or is larger than 4 GiB.
pub fn read_picture_bytes(path: &Path) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| {
            // Room for all of it at once, where the size is known.
            let size = file.metadata().map_or(0, |known| known.len());
            bytes.reserve(size.min(MAX_FILE_BYTES) as usize + 1);
            file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes)
        })
        .context("cannot be read")?;
    ensure!(!bytes.is_empty(), "is empty; export the file again");
    ensure!(bytes.len() as u64 <= MAX_FILE_BYTES, "is larger than 4 GiB: scale the picture down");
    Ok(bytes)
}

/// Refuses a claim of width and height before anything is allocated for it.
pub fn check_pixels(width: usize, height: usize) -> Result<()> {
    ensure!(
        width.max(height) <= MAX_SIDE && (1..=MAX_PIXELS).contains(&width.saturating_mul(height)),
        "claims {width} × {height} pixels; up to 16384 × 8192 can be read: scale the picture down"
    );
    Ok(())
}

/// The path that is meant by what was typed or pasted: without quotes and blanks around it, `~/` taken as the home and a
/// `file://` address as the file that it names. What names a file as it stands is left so.
pub fn typed_path(text: &str) -> String {
    let text = text.trim();
    if Path::new(text).exists() {
        return text.to_owned();
    }
    let quoted = |quote: char| text.strip_prefix(quote)?.strip_suffix(quote);
    let text = quoted('"').or_else(|| quoted('\'')).unwrap_or(text).trim();
    if let Some(address) = text.strip_prefix("file://") {
        // What comes before the path is the machine.
        let path = address.find('/').map_or(address, |at| &address[at..]);
        let path = percent_decoded(path);
        return match path.strip_prefix('/').filter(|_| cfg!(windows)) {
            Some(with_drive) => with_drive.to_owned(),
            None => path,
        };
    }
    match (text.strip_prefix('~'), std::env::home_dir()) {
        (Some(""), Some(home)) => home.to_string_lossy().into_owned(),
        (Some(rest), Some(home)) if rest.starts_with(['/', '\\']) => {
            home.join(rest.trim_start_matches(['/', '\\'])).to_string_lossy().into_owned()
        }
        _ => text.to_owned(),
    }
}

/// `%20` and the like as the bytes that they stand for; a sign that no two hexadecimal digits follow stays.
fn percent_decoded(text: &str) -> String {
    let (mut bytes, mut rest) = (Vec::new(), text.as_bytes());
    while let Some((&first, after)) = rest.split_first() {
        let digit = |at: usize| char::from(*after.get(at)?).to_digit(16);
        match digit(0).zip(digit(1)).filter(|_| first == b'%') {
            Some((high, low)) => {
                bytes.push((16 * high + low) as u8);
                rest = &after[2..];
            }
            None => {
                bytes.push(first);
                rest = after;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// A folder that an environment variable names; None where it is not set or empty.
pub fn folder_of(variable: &str) -> Option<PathBuf> {
    std::env::var_os(variable).filter(|value| !value.is_empty()).map(PathBuf::from)
}

/// Hairlight's own among the user's folders of one kind: in what `variable` names, else in `at_home` of the home; None
/// without a home.
pub fn user_folder(variable: &str, at_home: &str) -> Option<PathBuf> {
    let base = folder_of(variable).or_else(|| Some(std::env::home_dir()?.join(at_home)));
    Some(base?.join("hairlight"))
}

/// Where what a user would miss is kept, but would not look for: `$XDG_STATE_HOME/hairlight` or
/// `~/.local/state/hairlight`, on Windows in `%LOCALAPPDATA%`, on macOS in `~/Library/Application Support`.
pub fn state_folder() -> Option<PathBuf> {
    let (variable, at_home) = if cfg!(windows) {
        ("LOCALAPPDATA", "AppData/Local")
    } else if cfg!(target_os = "macos") {
        ("XDG_STATE_HOME", "Library/Application Support")
    } else {
        ("XDG_STATE_HOME", ".local/state")
    };
    user_folder(variable, at_home)
}

thread_local! {
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// Runs a decoder that may panic on damaged files and catches its panic, whose message is kept off stderr. The
/// hook that does so is set once and passes on every panic from outside such a call, on all threads.
pub fn catch_panic<T>(decode: impl FnOnce() -> T) -> Result<T, Box<dyn Any + Send>> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let previous = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !QUIET.try_with(Cell::get).unwrap_or(false) {
                previous(info);
            }
        }));
    });
    let outer = QUIET.replace(true);
    let result = panic::catch_unwind(AssertUnwindSafe(decode));
    QUIET.set(outer);
    result
}
