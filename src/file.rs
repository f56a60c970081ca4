//! Files written whole or not at all, and read without panic.

use std::any::Any;
use std::cell::Cell;
use std::io::Write;
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
