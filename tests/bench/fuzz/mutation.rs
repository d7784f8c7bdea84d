//! Mutations of a document: of its bytes, its structure, and its expressions.

use serde_json::{Map, Value, json};

/// Tokens of the expression grammar, and extreme numbers.
const WORDS: &[&str] = &[
    "+", "-", "*", "/", "^", "(", ")", ",", "x", "t", "pi", "e", "0", "1", "1e308", "1e-308", "-1", "0.5", "2", "sin(",
    "exp(", "log(", "sqrt(", "abs(", "max(", "min(", "atan2(", "pow(", "tanh(", "<", ">", "==", "if(", "sign(",
    "step(", " ", "x^x^x", "1/0", "0/0",
];

/// Numbers at the limits of ranges and types, which are often handled wrongly.
const NUMBERS: &[f64] =
    &[0.0, -0.0, 1.0, -1.0, 2.0, 0.5, 1e-9, 1e9, 1e17, -1e300, 1e308, 5e-324, 4_294_967_296.0, 9e15, 255.0, 1000.0];

/// A generator of mutations, reproducible from a seed.
pub struct Mutation {
    state: u64,
    /// JSON keys and values found in the example specifications.
    keys: Vec<String>,
    values: Vec<Value>,
}

impl Mutation {
    /// Creates a generator seeded by `seed`, with the keys and values of `corpus`.
    pub fn new(seed: u64, corpus: &[Vec<u8>]) -> Self {
        let mut mutation = Self { state: seed, keys: Vec::new(), values: Vec::new() };
        for document in corpus.iter().filter_map(|document| serde_json::from_slice(document).ok()) {
            mutation.learn(document);
        }
        mutation.keys.sort();
        mutation.keys.dedup();
        mutation
    }

    fn learn(&mut self, value: Value) {
        match &value {
            Value::Object(map) => map.iter().for_each(|(key, value)| {
                self.keys.push(key.clone());
                self.learn(value.clone());
            }),
            Value::Array(items) => items.iter().take(8).for_each(|item| self.learn(item.clone())),
            _ => {}
        }
        self.values.push(value);
    }

    /// Returns a mutated document of one of two corpora, more often of the first.
    pub fn change(&mut self, corpus: &[Vec<Vec<u8>>; 2]) -> Vec<u8> {
        let rare = usize::from(self.below(4) == 0 && !corpus[1].is_empty());
        let mut document = corpus[rare][self.below(corpus[rare].len())].clone();
        if let Ok(mut value) = serde_json::from_slice::<Value>(&document) {
            for _ in 0..=self.seldom() {
                let place = self.below(places(&value));
                self.change_at(&mut value, &mut { place });
            }
            document = value.to_string().into_bytes();
        }
        if self.below(16) == 0 {
            for _ in 0..=self.below(4) {
                self.change_bytes(&mut document);
            }
        }
        document
    }

    /// Mutates the JSON value at index `place`, counted depth first.
    fn change_at(&mut self, value: &mut Value, place: &mut usize) {
        if *place == 0 {
            *value = self.changed(value.take());
        }
        *place = place.wrapping_sub(1);
        let inner: Vec<&mut Value> = match value {
            Value::Object(map) => map.values_mut().collect(),
            Value::Array(items) => items.iter_mut().collect(),
            _ => return,
        };
        for value in inner {
            let size = places(value);
            if *place < size {
                return self.change_at(value, place);
            }
            *place -= size;
        }
    }

    fn changed(&mut self, value: Value) -> Value {
        match (value, self.below(12)) {
            (_, 0) => self.value(),
            (value, 1) => self.wrapped(value),
            (Value::Object(map), _) => Value::Object(self.changed_object(map)),
            (Value::Array(items), _) => Value::Array(self.changed_array(items)),
            (Value::String(text), _) => Value::String(self.changed_text(text)),
            (Value::Number(number), 2..8) => {
                json!(number.as_f64().unwrap_or_default() * [0.5, 2.0, -1.0][self.below(3)])
            }
            (Value::Number(_), _) => json!(NUMBERS[self.below(NUMBERS.len())]),
            (_, _) => self.scalar(),
        }
    }

    fn changed_object(&mut self, mut map: Map<String, Value>) -> Map<String, Value> {
        let keys: Vec<String> = map.keys().cloned().collect();
        let (old, new) = (self.of(&keys), self.key());
        match (self.below(3), old) {
            (0, Some(old)) => drop(map.remove(&old)),
            (1, Some(old)) => {
                let value = map.remove(&old).unwrap_or_default();
                map.insert(new, value);
            }
            (_, _) => {
                let value = self.value();
                map.insert(new, value);
            }
        }
        map
    }

    fn changed_array(&mut self, mut items: Vec<Value>) -> Vec<Value> {
        match (self.below(3), self.of(&items)) {
            (0, Some(_)) => drop(items.remove(self.below(items.len()))),
            (1, Some(item)) => (0..=self.below(20)).for_each(|_| items.push(item.clone())),
            (_, _) => items.push(self.value()),
        }
        items
    }

    fn changed_text(&mut self, text: String) -> String {
        let mut symbols: Vec<char> = text.chars().collect();
        for _ in 0..=self.seldom() {
            let from = self.below(symbols.len() + 1);
            let to = (from + self.below(6)).min(symbols.len());
            let word = match self.below(4) {
                0 => self.key(),
                1 => self.values_text(),
                _ => WORDS[self.below(WORDS.len())].to_owned(),
            };
            match self.below(4) {
                0 => drop(symbols.drain(from..to)),
                1 => drop(symbols.splice(from..from, word.repeat(1 + self.below(3)).chars())),
                2 => drop(symbols.splice(from..to, format!("({word})").chars())),
                _ => drop(symbols.splice(from..to, word.chars())),
            }
        }
        symbols.into_iter().take(2000).collect()
    }

    fn change_bytes(&mut self, bytes: &mut Vec<u8>) {
        let from = self.below(bytes.len() + 1);
        let to = (from + self.below(16)).min(bytes.len());
        match self.below(4) {
            0 => drop(bytes.drain(from..to)),
            1 => bytes.insert(from, self.next() as u8),
            2 => drop(bytes.splice(from..from, bytes[from..to].to_vec())),
            _ => bytes[from..to].iter_mut().for_each(|byte| *byte ^= 1 << (self.state % 8)),
        }
    }

    fn wrapped(&mut self, value: Value) -> Value {
        match self.below(4) {
            0 => json!([value]),
            1 => json!({self.key(): value}),
            2 => json!([value, value]),
            _ => (0..self.below(100)).fold(value, |value, _| json!([value])),
        }
    }

    /// Returns a random value from the examples, or a random scalar.
    fn value(&mut self) -> Value {
        match self.below(3) {
            0 => self.scalar(),
            _ => {
                let at = self.below(self.values.len());
                self.values[at].clone()
            }
        }
    }

    fn scalar(&mut self) -> Value {
        match self.below(8) {
            0 => Value::Null,
            1 => Value::Bool(self.below(2) == 0),
            2 => Value::String(self.key()),
            3 => json!(self.next() as i64),
            4 => json!(self.below(40)),
            _ => json!(NUMBERS[self.below(NUMBERS.len())]),
        }
    }

    fn values_text(&mut self) -> String {
        let at = self.below(self.values.len());
        self.values[at].as_str().map_or_else(|| "x".to_owned(), str::to_owned)
    }

    fn key(&mut self) -> String {
        let at = self.below(self.keys.len());
        self.keys[at].clone()
    }

    fn of<T: Clone>(&mut self, items: &[T]) -> Option<T> {
        items.get(self.below(items.len())).cloned()
    }

    /// Returns a geometrically distributed number: zero in half of all cases, one in a quarter, and so on.
    fn seldom(&mut self) -> u32 {
        self.next().trailing_zeros()
    }

    /// Returns a random number below `bound`.
    pub fn below(&mut self, bound: usize) -> usize {
        (self.next() % bound.max(1) as u64) as usize
    }

    /// Returns the next random number of `SplitMix64`.
    fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

/// Returns the number of JSON values in a value, itself included.
fn places(value: &Value) -> usize {
    1 + match value {
        Value::Object(map) => map.values().map(places).sum(),
        Value::Array(items) => items.iter().map(places).sum::<usize>(),
        _ => 0,
    }
}
