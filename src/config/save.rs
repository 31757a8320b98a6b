//! Settings back into a file, whose words, order and comments stay as they are.

use super::{Config, ConfigError};
use toml_edit::{DocumentMut, Item, Table, TableLike, Value};

/// What a new file begins as: every key with its comment.
const BUNDLED: &str = include_str!("../../config.toml");
/// Significant digits of a number that is written.
const DIGITS: usize = 6;

impl Config {
    /// The text of a configuration file with these settings: `text`, the file as it is (`None`: there is none yet, and every key
    /// is written with its comment), with the values that differ changed and nothing else. A key that the file leaves out is
    /// added only if its value is not the default, and a table that it leaves out as a whole. `origin` names the file in
    /// errors. Errors: `text` is no configuration, a value is out of its range.
    pub fn rewrite(&self, text: Option<&str>, origin: &str) -> Result<String, ConfigError> {
        self.validate().map_err(|source| ConfigError::Setting { origin: origin.to_owned(), source })?;
        let text = text.unwrap_or(BUNDLED);
        let unreadable = |e| ConfigError::Parse { origin: origin.to_owned(), source: Box::new(e) };
        // toml's own parser first: its errors name the line in the same words as when a file is read
        toml::from_str::<Self>(text).map_err(unreadable)?;
        let mut document: DocumentMut =
            text.parse().map_err(|e: toml_edit::TomlError| unreadable(serde::de::Error::custom(e.to_string())))?;
        let table =
            |config: &Self| toml::Table::try_from(config).map_err(|e| unreadable(serde::de::Error::custom(e.to_string())));
        merge(document.as_table_mut(), &table(self)?, &table(&Self::default())?);
        Ok(document.to_string())
    }
}

/// Brings the values of a table to `wanted`.
fn merge(table: &mut dyn TableLike, wanted: &toml::Table, defaults: &toml::Table) {
    for (key, value) in wanted {
        let default = defaults.get(key);
        if let toml::Value::Table(inner) = value {
            let none = toml::Table::new();
            let defaults = default.and_then(toml::Value::as_table).unwrap_or(&none);
            if !table.contains_key(key) {
                if inner == defaults {
                    continue;
                }
                table.insert(key, Item::Table(Table::new()));
            }
            if let Some(below) = table.get_mut(key).and_then(Item::as_table_like_mut) {
                // a material's three numbers go together
                let whole = below.is_empty() && !inner.values().any(toml::Value::is_table);
                merge(below, inner, if whole { &none } else { defaults });
            }
            continue;
        }
        match table.get_mut(key).and_then(Item::as_value_mut) {
            Some(old) if same(old, value) => {}
            Some(old) => {
                let decor = old.decor().clone();
                *old = written(value);
                *old.decor_mut() = decor;
            }
            None if default == Some(value) => {}
            None => {
                table.insert(key, Item::Value(written(value)));
            }
        }
    }
}

/// True if the file's value says the same, to the digits that would be written.
fn same(old: &Value, new: &toml::Value) -> bool {
    let number = |v: &Value| v.as_float().or(v.as_integer().map(|i| i as f64));
    match new {
        toml::Value::Float(x) => number(old).is_some_and(|o| o == *x || o == rounded(*x)),
        toml::Value::Integer(i) => old.as_integer() == Some(*i),
        toml::Value::Boolean(b) => old.as_bool() == Some(*b),
        toml::Value::String(s) => old.as_str() == Some(s),
        toml::Value::Array(new) => {
            old.as_array().is_some_and(|old| old.len() == new.len() && old.iter().zip(new).all(|(o, n)| same(o, n)))
        }
        toml::Value::Datetime(_) | toml::Value::Table(_) => false,
    }
}

fn written(value: &toml::Value) -> Value {
    match value {
        toml::Value::Float(x) => rounded(*x).into(),
        toml::Value::Integer(i) => (*i).into(),
        toml::Value::Boolean(b) => (*b).into(),
        toml::Value::String(s) => s.as_str().into(),
        toml::Value::Array(values) => values.iter().map(written).collect::<toml_edit::Array>().into(),
        // settings have neither
        toml::Value::Datetime(_) | toml::Value::Table(_) => toml_edit::InlineTable::new().into(),
    }
}

fn rounded(x: f64) -> f64 {
    format!("{x:.*e}", DIGITS - 1).parse().unwrap_or(x)
}

#[cfg(test)]
mod tests {
    use super::super::PresetName;
    use super::*;
    use crate::surgery::WallMode;

    #[test]
    fn a_new_file_is_the_bundled_one_with_the_changes() {
        assert_eq!(Config::default().rewrite(None, "x").unwrap(), BUNDLED);
        let mut config = Config::default();
        config.tear.wall = WallMode::Closed;
        config.tear.width = 0.012_345_678_9;
        config.dynamics.preset = PresetName::Firm;
        let text = config.rewrite(None, "x").unwrap();
        let changed: Vec<(&str, &str)> = BUNDLED.lines().zip(text.lines()).filter(|(a, b)| a != b).collect();
        assert_eq!(changed.len(), 3, "{changed:?}");
        for (before, after) in changed {
            assert!(before.contains('#'));
            assert_eq!(before.split_once('#').map(|x| x.1), after.split_once('#').map(|x| x.1), "the comment stays");
        }
        let back = Config::parse(&text, "x").unwrap();
        assert_eq!((back.tear.width, back.tear.wall), (0.012_345_7, WallMode::Closed));
        assert_eq!(back.dynamics.preset, PresetName::Firm);
    }

    #[test]
    fn a_users_file_keeps_its_words_and_gains_what_differs_from_the_defaults() {
        let text = "# mine\n[vr]\nrefresh_rate = 0 # whatever it likes\n\n[tear] # wounds\n  gap = 0.05   # wide\n";
        let mut config = Config::parse(text, "x").unwrap();
        assert_eq!(config.rewrite(Some(text), "x").unwrap(), text, "nothing has changed");
        config.tear.gap = 0.07;
        config.tear.opening_time = 2.0;
        config.dynamics.soft.frequency = 4.5;
        let after = config.rewrite(Some(text), "x").unwrap();
        for kept in ["# mine\n", "refresh_rate = 0 # whatever it likes\n", "[tear] # wounds\n", "  gap = 0.07   # wide\n"] {
            assert!(after.contains(kept), "{kept:?} is missing from:\n{after}");
        }
        assert!(!after.contains("width") && !after.contains("count"), "defaults stay out:\n{after}");
        assert_eq!(Config::parse(&after, "x").unwrap(), config, "{after}");
    }

    #[test]
    fn a_broken_file_and_a_bad_value_are_refused() {
        let broken = Config::default().rewrite(Some("[tear]\nwidth = \n"), "my.toml").unwrap_err().to_string();
        assert!(broken.contains("my.toml") && broken.contains("line 2"), "{broken}");
        let mut config = Config::default();
        config.tear.width = -1.0;
        assert!(config.rewrite(None, "x").unwrap_err().to_string().contains("tear.width"));
    }
}
