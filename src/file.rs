//! Files written whole or not at all, and read without panic.

use std::any::Any;
use std::cell::Cell;
use std::fs::File;
use std::io::{Read, Write};
use std::panic::{self, AssertUnwindSafe};
use std::path::{Path, PathBuf};
use std::sync::Once;

use anyhow::{Context, Result, ensure};

/// Writes a file under a temporary name beside `path` and renames it once it is whole.
pub fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut std::fs::File) -> Result<()>,
) -> Result<()> {
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let attempt = || -> Result<()> {
        // A file would take the place of a device, a pipe or a folder.
        ensure!(path.is_file() || !path.exists(), "something that is no file is there");
        let mut file = tempfile::NamedTempFile::new_in(folder)?;
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
