//! Runs the program and looks at what it says.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// What a run left behind.
pub struct Ran {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

/// A folder of its own, and the program run in it.
pub struct Place {
    folder: TempDir,
}

impl Place {
    pub fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), bytes).unwrap();
    }

    pub fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).unwrap()
    }

    /// Runs `incise` with arguments that are separated by blanks.
    pub fn run(&self, arguments: &str) -> Ran {
        self.run_with(arguments, &[])
    }

    /// The same with environment variables.
    pub fn run_with(&self, arguments: &str, environment: &[(&str, &str)]) -> Ran {
        let mut command = Command::new(env!("CARGO_BIN_EXE_incise"));
        // A machine with a display would get a window from plain `incise`.
        command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
        command.args(arguments.split_whitespace()).current_dir(self.folder.path());
        command.envs(environment.iter().copied());
        let Output { status, stdout, stderr } = command.output().unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        let ran = Ran { code: status.code().unwrap_or(-1), stdout: text(stdout), stderr: text(stderr) };
        assert!(!ran.stderr.contains("panicked"), "incise {arguments}\n{}", ran.stderr);
        ran
    }

    /// A run that has to succeed.
    pub fn ok(&self, arguments: &str) -> String {
        let ran = self.run(arguments);
        assert_eq!(ran.code, 0, "incise {arguments}\n{}", ran.stderr);
        ran.stdout
    }

    /// A run that has to print exactly one JSON object and nothing else.
    pub fn ok_json(&self, arguments: &str) -> Value {
        let stdout = self.ok(&format!("{arguments} --json"));
        let value: Value = serde_json::from_str(&stdout).unwrap_or_else(|e| panic!("incise {arguments}: {e}\n{stdout}"));
        assert!(value.is_object(), "incise {arguments}: {stdout}");
        value
    }

    /// A run that is refused: exit 2, nothing on stdout, and one line on stderr that holds all of `words`.
    pub fn refused(&self, arguments: &str, words: &[&str]) {
        self.fails(arguments, 2, words);
    }

    /// A run that ends with `code`, nothing on stdout, and one line on stderr that holds all of `words`.
    pub fn fails(&self, arguments: &str, code: i32, words: &[&str]) {
        let ran = self.run(arguments);
        assert_eq!(ran.code, code, "incise {arguments}\n{}", ran.stderr);
        assert_eq!(ran.stdout, "", "incise {arguments}");
        let says = |line: &str| {
            (line.starts_with("incise: ") || line.starts_with("error: ")) && words.iter().all(|word| line.contains(word))
        };
        // a script's error shows the place, so it may take several lines
        let whole = ran.stderr.replace('\n', " ");
        assert!(ran.stderr.lines().any(says) || says(&whole), "incise {arguments}: no {words:?} in\n{}", ran.stderr);
    }
}

/// What a value has to be.
#[derive(Clone, Copy, Debug)]
pub enum Is {
    Count,
    Number,
    Text,
    Flag,
    List,
    Object,
    /// `null` or text.
    MaybeText,
}

impl Is {
    fn holds(self, value: &Value) -> bool {
        match self {
            Is::Count => value.is_u64(),
            Is::Number => value.as_f64().is_some_and(f64::is_finite),
            Is::Text => value.is_string(),
            Is::Flag => value.is_boolean(),
            Is::List => value.is_array(),
            Is::Object => value.is_object(),
            Is::MaybeText => value.is_null() || value.is_string(),
        }
    }
}

/// The first key that is missing or of another type.
pub fn lacks(value: &Value, rules: &[(Is, &[&'static str])]) -> Option<&'static str> {
    let of = |&(is, keys): &(Is, &[&'static str])| keys.iter().find(|k| !value.get(**k).is_some_and(|v| is.holds(v))).copied();
    rules.iter().find_map(of)
}

#[track_caller]
pub fn has(value: &Value, rules: &[(Is, &[&'static str])]) {
    assert_eq!(lacks(value, rules), None, "{value:#}");
}

pub fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

pub fn count(value: &Value) -> u64 {
    value.as_u64().unwrap_or_else(|| panic!("{value} is no count"))
}

pub fn list(value: &Value) -> &[Value] {
    value.as_array().unwrap_or_else(|| panic!("{value} is no list"))
}

/// Three numbers.
pub fn point(value: &Value) -> [f64; 3] {
    let numbers: Vec<f64> = list(value).iter().map(number).collect();
    numbers.try_into().unwrap()
}

#[track_caller]
pub fn close(a: f64, b: f64, relative: f64) {
    assert!((a - b).abs() <= relative * a.abs().max(b.abs()), "{a} and {b} differ by more than {relative}");
}

/// Names of the files in a folder, sorted.
pub fn files_in(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn the_helper_finds_missing_and_mistyped_keys() {
    let value = serde_json::json!({"a": 1, "b": "x", "c": null});
    assert_eq!(lacks(&value, &[(Is::Count, &["a"]), (Is::Text, &["b"]), (Is::MaybeText, &["c"])]), None);
    assert_eq!(lacks(&value, &[(Is::Number, &["a", "d"])]), Some("d"));
    assert_eq!(lacks(&value, &[(Is::Count, &["b"])]), Some("b"));
    assert_eq!(lacks(&value, &[(Is::Number, &["c"])]), Some("c"));
}
