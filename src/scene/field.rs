//! What a field of the scene is: key, flag, kind, range, help; and its value as text and as TOML.
//!
//! Parsing, error texts, `--help` and `scene.toml` all come from the one table in `table.rs`;
//! nothing else names a key or a range.

use std::path::Path;

use super::Scene;

/// One field of a [`Scene`].
#[derive(Clone, Copy)]
pub struct Field {
    /// Table and name in `scene.toml`, as `fibre.eta`.
    pub key: &'static str,
    /// Long flag without its dashes.
    pub flag: &'static str,
    /// Short flag, where there is one.
    pub short: Option<char>,
    pub kind: Kind,
    /// Unit of a number, empty where it has none.
    pub unit: &'static str,
    /// The word that leaves the field to the program ([`Value::Unset`]), where that is possible.
    pub unset: Option<&'static str>,
    /// Fields that state one thing in different ways; one level may use only one of the ways.
    pub alternative: Option<Alternative>,
    /// One line, without a full stop.
    pub help: &'static str,
    /// `None` where another alternative holds.
    pub(super) get: fn(&Scene) -> Option<Value>,
    /// Takes values that `kind` has accepted.
    pub(super) set: fn(&mut Scene, Value),
}

/// One way to state a thing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Alternative {
    /// What is stated, as "the colour of the fibre".
    pub of: &'static str,
    /// Which way; fields of the same way go together.
    pub way: &'static str,
}

/// The type and range of a field. Ranges include both ends.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    Number {
        min: f64,
        max: f64,
    },
    /// A whole number, below 2⁵³.
    Integer {
        min: f64,
        max: f64,
    },
    /// One of these words.
    Choice(&'static [&'static str]),
    /// Free text.
    Text,
    /// A [`super::Target`].
    Target,
    /// A file to read, `builtin:` and one of `builtins`, or one of `words`.
    Source {
        builtins: &'static [&'static str],
        words: &'static [&'static str],
    },
    /// A file to write, with one of these extensions.
    Output(&'static [&'static str]),
    /// Three numbers.
    Vector {
        min: f64,
        max: f64,
    },
    /// Linear RGB, sRGB as `#rrggbb`, or one of `words`.
    Color {
        min: f64,
        max: f64,
        words: &'static [&'static str],
    },
    /// Width × height, in pixels.
    Size {
        min: f64,
        max: f64,
    },
}

/// The value of a field, whatever its kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Left to the program.
    Unset,
    Number(f64),
    Text(String),
    List(Vec<f64>),
}

impl Field {
    /// The table in `scene.toml` that holds this field.
    pub fn group(&self) -> &'static str {
        self.key.split_once('.').map_or("", |(group, _)| group)
    }

    /// The key within its table.
    pub fn name(&self) -> &'static str {
        self.key.split_once('.').map_or(self.key, |(_, name)| name)
    }

    /// The value that `scene` holds; `None` where another alternative holds.
    pub fn get(&self, scene: &Scene) -> Option<Value> {
        (self.get)(scene)
    }

    /// Sets the value in `scene`. The error is one line that names key and range, and nothing is set.
    pub fn put(&self, scene: &mut Scene, value: Value) -> Result<(), String> {
        (self.set)(scene, self.check(value)?);
        Ok(())
    }

    /// Reads what a user types for this field: a number, a word, `1,2,3`, `[1, 2, 3]`, `720x480`,
    /// `#rrggbb`; quotes around text are taken off. The error is one line that names key and range.
    pub fn parse(&self, text: &str) -> Result<Value, String> {
        let text = text.trim();
        let text = text.strip_prefix('"').and_then(|t| t.strip_suffix('"')).unwrap_or(text);
        let value = match self.kind {
            _ if self.unset == Some(text) => Some(Value::Unset),
            Kind::Number { .. } | Kind::Integer { .. } => text.parse().ok().map(Value::Number),
            Kind::Choice(_) | Kind::Text | Kind::Target | Kind::Source { .. } | Kind::Output(_) => {
                Some(Value::Text(text.to_owned()))
            }
            Kind::Vector { .. } => list(text, ','),
            Kind::Color { words, .. } if words.contains(&text) => {
                Some(Value::Text(text.to_owned()))
            }
            Kind::Color { .. } => srgb(text).or_else(|| list(text, ',')),
            Kind::Size { .. } => list(text, 'x').or_else(|| list(text, ',')),
        };
        match value {
            Some(value) => self.check(value),
            None => Err(self.must_be(&format!("`{text}`"))),
        }
    }

    /// Reads a TOML value for this field. The error is one line that names key and range.
    pub(super) fn read_toml(&self, value: &toml::de::DeValue) -> Result<Value, String> {
        use toml::de::DeValue;
        match (value, self.kind) {
            // Quoted numbers are a mistake, though the command line could not tell.
            (
                DeValue::String(text),
                Kind::Number { .. } | Kind::Integer { .. } | Kind::Vector { .. },
            ) if self.unset != Some(text) => Err(self.must_be(&format!("the text \"{text}\""))),
            (DeValue::String(text), _) => self.parse(text),
            (DeValue::Array(array), _) => {
                let numbers = array.iter().map(|item| number_of(item.get_ref()));
                match numbers.collect() {
                    Some(numbers) => self.check(Value::List(numbers)),
                    None => Err(self.must_be("that array")),
                }
            }
            (other, _) => match number_of(other) {
                Some(number) => self.check(Value::Number(number)),
                None => Err(self.must_be(article(other))),
            },
        }
    }

    /// Accepts a value of the right type within the range.
    fn check(&self, value: Value) -> Result<Value, String> {
        let within = |x: &f64, min: f64, max: f64| (min..=max).contains(x);
        let whole = |x: &f64, min: f64, max: f64| within(x, min, max) && x.fract() == 0.0;
        let fits = match (&value, self.kind) {
            (Value::Unset, _) => self.unset.is_some(),
            (Value::Number(x), Kind::Number { min, max }) => within(x, min, max),
            (Value::Number(x), Kind::Integer { min, max }) => whole(x, min, max),
            (Value::Text(text), Kind::Choice(words)) => words.contains(&text.as_str()),
            (Value::Text(text), Kind::Color { words, .. }) => words.contains(&text.as_str()),
            (Value::Text(text), Kind::Text) => !text.is_empty(),
            (Value::Text(text), Kind::Target) => super::Target::parse(text).is_some(),
            (Value::Text(text), Kind::Source { builtins, .. }) => {
                match text.strip_prefix("builtin:") {
                    Some(name) => builtins.contains(&name),
                    None => !text.is_empty(),
                }
            }
            (Value::Text(text), Kind::Output(extensions)) => {
                let extension = Path::new(text).extension().and_then(|e| e.to_str());
                extension.is_some_and(|e| extensions.iter().any(|x| x.eq_ignore_ascii_case(e)))
            }
            (Value::List(xs), Kind::Vector { min, max } | Kind::Color { min, max, .. }) => {
                xs.len() == 3 && xs.iter().all(|x| within(x, min, max))
            }
            (Value::List(xs), Kind::Size { min, max }) => {
                xs.len() == 2 && xs.iter().all(|x| whole(x, min, max))
            }
            _ => false,
        };
        if fits { Ok(value) } else { Err(self.must_be(&self.format(&value))) }
    }

    fn must_be(&self, found: &str) -> String {
        format!("`{}` must be {}, not {found}", self.key, self.expects())
    }

    /// Type, range and unit in words, as "a number from 1 to 3".
    pub fn expects(&self) -> String {
        let range = |min, max| {
            let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
            format!("from {} to {}{unit}", number(min), number(max))
        };
        let mut text = match self.kind {
            Kind::Number { min, max } => format!("a number {}", range(min, max)),
            Kind::Integer { min, max } => format!("a whole number {}", range(min, max)),
            Kind::Choice(words) => format!("one of {}", words.join(", ")),
            Kind::Text => "a name".to_owned(),
            Kind::Target => "an error such as 20% or a frame time such as 50ms".to_owned(),
            Kind::Source { builtins, words } => {
                let mut ways = vec!["a file".to_owned()];
                ways.extend(builtins.iter().map(|name| format!("builtin:{name}")));
                ways.extend(words.iter().map(|&word| word.to_owned()));
                ways.join(", ")
            }
            Kind::Output(extensions) => format!("a file ending in .{}", extensions.join(" or .")),
            Kind::Vector { min, max } => format!("three numbers x,y,z {}", range(min, max)),
            Kind::Color { min, max, words } => {
                let mut ways = vec!["#rrggbb (sRGB)".to_owned()];
                ways.extend(words.iter().map(|&word| word.to_owned()));
                format!("{} or three linear numbers r,g,b {}", ways.join(", "), range(min, max))
            }
            Kind::Size { min, max } => {
                format!("a size such as 720x480, each side {}", range(min, max))
            }
        };
        if let Some(word) = self.unset {
            text += &format!(", or {word}");
        }
        text
    }

    /// What stands for the value in `--help`.
    pub fn placeholder(&self) -> &'static str {
        match self.kind {
            Kind::Number { .. } => "NUMBER",
            Kind::Integer { .. } => "N",
            Kind::Choice(_) => "WORD",
            Kind::Text => "NAME",
            Kind::Target => "TARGET",
            Kind::Source { .. } => "SOURCE",
            Kind::Output(_) => "FILE",
            Kind::Vector { .. } => "X,Y,Z",
            Kind::Color { .. } => "COLOR",
            Kind::Size { .. } => "WxH",
        }
    }

    /// A value as a TOML literal of this field.
    pub fn format(&self, value: &Value) -> String {
        match value {
            Value::Unset => quote(self.unset.unwrap_or("")),
            Value::Number(x) => number(*x),
            Value::Text(text) => quote(text),
            Value::List(xs) => {
                let items: Vec<String> = xs.iter().map(|&x| number(x)).collect();
                format!("[{}]", items.join(", "))
            }
        }
    }

    /// A path that a scene file states, as seen from the working folder.
    pub(super) fn relocate(&self, value: Value, folder: &Path) -> Value {
        match (value, self.kind) {
            (Value::Text(text), Kind::Source { words, .. })
                if !text.starts_with("builtin:") && !words.contains(&text.as_str()) =>
            {
                Value::Text(folder.join(text).to_string_lossy().into_owned())
            }
            (Value::Text(text), Kind::Output(_)) => {
                Value::Text(folder.join(text).to_string_lossy().into_owned())
            }
            (value, _) => value,
        }
    }
}

/// A field's place in the scene's structs, to and from a [`Value`].
pub(super) trait Slot {
    fn value(&self) -> Value;
    /// # Panics
    /// On a value that the field's kind would not have accepted.
    fn assign(&mut self, value: Value);
}

impl Slot for f64 {
    fn value(&self) -> Value {
        Value::Number(*self)
    }
    fn assign(&mut self, value: Value) {
        let Value::Number(x) = value else { unreachable!("a checked number") };
        *self = x;
    }
}

impl Slot for u32 {
    fn value(&self) -> Value {
        Value::Number(f64::from(*self))
    }
    fn assign(&mut self, value: Value) {
        let Value::Number(x) = value else { unreachable!("a checked number") };
        *self = x as u32;
    }
}

impl Slot for String {
    fn value(&self) -> Value {
        Value::Text(self.clone())
    }
    fn assign(&mut self, value: Value) {
        let Value::Text(text) = value else { unreachable!("a checked text") };
        *self = text;
    }
}

impl Slot for [f64; 3] {
    fn value(&self) -> Value {
        Value::List(self.to_vec())
    }
    fn assign(&mut self, value: Value) {
        let Value::List(xs) = value else { unreachable!("a checked vector") };
        self.copy_from_slice(&xs);
    }
}

impl Slot for [u32; 2] {
    fn value(&self) -> Value {
        Value::List(self.iter().map(|&x| f64::from(x)).collect())
    }
    fn assign(&mut self, value: Value) {
        let Value::List(xs) = value else { unreachable!("a checked size") };
        *self = [xs[0] as u32, xs[1] as u32];
    }
}

impl<T: Slot + Default> Slot for Option<T> {
    fn value(&self) -> Value {
        self.as_ref().map_or(Value::Unset, Slot::value)
    }
    fn assign(&mut self, value: Value) {
        *self = (value != Value::Unset).then(|| {
            let mut slot = T::default();
            slot.assign(value);
            slot
        });
    }
}

/// Defines an enum whose variants are words of a scene.
macro_rules! choice {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $word:literal,)+ }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum $name {
            $($(#[$variant_doc])* $variant,)+
        }

        impl $name {
            /// The words of a scene file, in the order of the variants.
            pub const WORDS: &'static [&'static str] = &[$($word),+];

            /// The variant of a word; the first for any other.
            pub fn named(word: &str) -> Self {
                let known = [$(($word, $name::$variant)),+];
                known.into_iter().find(|(w, _)| *w == word).unwrap_or(known[0]).1
            }

            /// The word of a scene file for this variant.
            pub fn word(self) -> &'static str {
                match self {
                    $($name::$variant => $word,)+
                }
            }
        }

        impl $crate::scene::field::Slot for $name {
            fn value(&self) -> $crate::scene::field::Value {
                $crate::scene::field::Value::Text(self.word().to_owned())
            }
            fn assign(&mut self, value: $crate::scene::field::Value) {
                let $crate::scene::field::Value::Text(word) = value else {
                    unreachable!("a checked word")
                };
                *self = Self::named(&word);
            }
        }
    };
}
pub(super) use choice;

/// Shortest text that reads back to the same number; valid TOML for finite numbers.
fn number(x: f64) -> String {
    if x == 0.0 || (1e-4..1e15).contains(&x.abs()) { format!("{x}") } else { format!("{x:e}") }
}

fn quote(text: &str) -> String {
    toml::Value::from(text).to_string()
}

/// Numbers with a separator between them, with or without brackets around.
fn list(text: &str, separator: char) -> Option<Value> {
    let inner = text.strip_prefix('[').and_then(|t| t.strip_suffix(']')).unwrap_or(text);
    let numbers = inner.split(separator).map(|item| item.trim().parse().ok());
    numbers.collect::<Option<Vec<f64>>>().map(Value::List)
}

/// A channel of sRGB (IEC 61966-2-1), 0 to 1, in linear light.
pub fn srgb_to_linear(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// `#rrggbb` in sRGB, as linear RGB.
fn srgb(text: &str) -> Option<Value> {
    let digits = text.strip_prefix('#').filter(|d| d.len() == 6)?;
    let packed = digits.bytes().all(|b| b.is_ascii_hexdigit());
    let packed = packed.then(|| u32::from_str_radix(digits, 16).ok()).flatten()?;
    let linear = |shift: u32| srgb_to_linear(f64::from((packed >> shift) & 0xff) / 255.0);
    Some(Value::List(vec![linear(16), linear(8), linear(0)]))
}

fn number_of(value: &toml::de::DeValue) -> Option<f64> {
    match value {
        toml::de::DeValue::Integer(i) => {
            i64::from_str_radix(i.as_str(), i.radix()).ok().map(|i| i as f64)
        }
        toml::de::DeValue::Float(f) => f.as_str().parse().ok(),
        _ => None,
    }
}

fn article(value: &toml::de::DeValue) -> &'static str {
    use toml::de::DeValue;
    match value {
        DeValue::String(_) => "text",
        DeValue::Integer(_) | DeValue::Float(_) => "that number",
        DeValue::Boolean(_) => "a boolean",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "an array",
        DeValue::Table(_) => "a table",
    }
}
