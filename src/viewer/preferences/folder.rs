//! Where a user's configuration is kept, by system.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use super::SaveError;

/// Systems that keep it in different places.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum System {
    /// Linux and others, by the XDG Base Directory Specification.
    Unix,
    /// macOS.
    Mac,
    /// Windows.
    Windows,
}

impl System {
    /// The one that this program runs on.
    pub fn here() -> Self {
        if cfg!(target_os = "windows") {
            System::Windows
        } else if cfg!(target_os = "macos") {
            System::Mac
        } else {
            System::Unix
        }
    }
}

/// The file of preferences, from the environment's variables.
///
/// # Errors
///
/// The variable that is needed is not set, or empty.
pub fn file_path(
    system: System,
    variable: impl Fn(&'static str) -> Option<OsString>,
) -> Result<PathBuf, SaveError> {
    let folder = |name| {
        let value = variable(name).filter(|value| !value.is_empty());
        value.map(PathBuf::from).ok_or(SaveError::NoFolder(name))
    };
    let configuration = match system {
        System::Windows => folder("APPDATA")?,
        System::Mac => folder("HOME")?.join("Library").join("Application Support"),
        // The specification has relative paths ignored.
        System::Unix => match folder("XDG_CONFIG_HOME").ok().filter(|path| is_rooted(path)) {
            Some(path) => path,
            None => folder("HOME")?.join(".config"),
        },
    };
    Ok(configuration.join("voxsight").join("viewer.json"))
}

/// Begins at the root of a Unix file system, on whatever system this is asked.
fn is_rooted(path: &Path) -> bool {
    path.as_os_str().as_encoded_bytes().starts_with(b"/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_system_has_its_place() {
        let path = |system, variables: &[(&str, &str)]| {
            let value =
                |name: &str| variables.iter().find(|(n, _)| *n == name).map(|(_, value)| value.into());
            file_path(system, value).map_err(|error| error.to_string())
        };
        let (home, xdg) = (("HOME", "/home/ada"), ("XDG_CONFIG_HOME", "/etc/ada"));
        for (system, variables, expected) in [
            (System::Unix, &[home, xdg][..], "/etc/ada/voxsight/viewer.json"),
            (System::Unix, &[xdg], "/etc/ada/voxsight/viewer.json"),
            (System::Unix, &[home], "/home/ada/.config/voxsight/viewer.json"),
            (System::Unix, &[home, ("XDG_CONFIG_HOME", "")], "/home/ada/.config/voxsight/viewer.json"),
            (System::Unix, &[home, ("XDG_CONFIG_HOME", "rel")], "/home/ada/.config/voxsight/viewer.json"),
            (System::Mac, &[home, xdg], "/home/ada/Library/Application Support/voxsight/viewer.json"),
            (System::Windows, &[home, ("APPDATA", "/Roaming")], "/Roaming/voxsight/viewer.json"),
        ] {
            assert_eq!(path(system, variables).unwrap(), Path::new(expected), "{system:?} {variables:?}");
        }
        for (system, variable) in
            [(System::Unix, "HOME"), (System::Mac, "HOME"), (System::Windows, "APPDATA")]
        {
            for variables in [&[][..], &[(variable, "")]] {
                assert!(path(system, variables).unwrap_err().contains(variable));
            }
        }
    }
}
