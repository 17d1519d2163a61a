//! One golden file: typed, shape-checked access to its arrays, and a record of which were looked at.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context, Result, ensure};
use tch::Tensor;

use crate::harness::npz::{self, ArrayValues, NpzArray};

/// Stored gradients and variables of more elements keep every [`STRIDE`]th of them only.
const STORED_WHOLE: i64 = 4096;
const STRIDE: i64 = 97;
/// Names the arrays that another file of the folder holds: texts `array=file`.
const SHARED: &str = "shared";

/// The arrays of a file. Every accessor's error names the tensor.
#[derive(Debug)]
pub struct Golden {
    /// File name without `.npz`.
    pub stem: String,
    arrays: BTreeMap<String, NpzArray>,
    looked_at: RefCell<BTreeSet<String>>,
}

impl Golden {
    /// Reads a file, and from its neighbours the arrays that it shares with them.
    ///
    /// # Errors
    /// See [`npz::read`]; a shared array that the file holds itself or that the other one lacks.
    pub fn read(path: &Path) -> Result<Self> {
        let stem = path.file_stem().context("has no name")?.to_string_lossy().into_owned();
        let mut golden = Golden { stem, arrays: npz::read(path)?, looked_at: RefCell::default() };
        if golden.has(SHARED) {
            let shared = golden.shared(path)?;
            golden.arrays.extend(shared);
        }
        Ok(golden)
    }

    fn shared(&self, path: &Path) -> Result<BTreeMap<String, NpzArray>> {
        let mut files: BTreeMap<&str, BTreeMap<String, NpzArray>> = BTreeMap::new();
        let mut shared = BTreeMap::new();
        for text in self.texts(SHARED)? {
            let (name, stem) = text.split_once('=').with_context(|| format!("tensor {SHARED}: {text:?} has no ="))?;
            ensure!(!self.has(name), "tensor {name} is in the file and shared with {stem}.npz");
            if !files.contains_key(stem) {
                let read = npz::read(&path.with_file_name(format!("{stem}.npz")));
                files.insert(stem, read.with_context(|| format!("{stem}.npz, with which it shares {name}"))?);
            }
            let array = files.get_mut(stem).and_then(|file| file.remove(name));
            shared.insert(name.to_string(), array.with_context(|| format!("tensor {name} is missing in {stem}.npz"))?);
        }
        Ok(shared)
    }

    pub fn has(&self, name: &str) -> bool {
        self.arrays.contains_key(name)
    }

    /// Names that start with `prefix`, without it.
    pub fn names_under(&self, prefix: &str) -> Vec<&str> {
        self.arrays.keys().filter_map(|name| name.strip_prefix(prefix)).collect()
    }

    fn array(&self, name: &str) -> Result<&NpzArray> {
        self.looked_at.borrow_mut().insert(name.to_string());
        self.arrays.get(name).with_context(|| format!("tensor {name} is missing"))
    }

    /// Finite numbers of any shape, in double precision.
    pub fn floats(&self, name: &str) -> Result<Tensor> {
        let tensor = self.floats_or_nan(name)?;
        ensure!(tensor.isfinite().all().int64_value(&[]) != 0, "tensor {name} holds a NaN or an infinity");
        Ok(tensor)
    }

    /// Finite numbers of this shape, in double precision.
    pub fn tensor(&self, name: &str, shape: &[i64]) -> Result<Tensor> {
        let tensor = self.floats(name)?;
        ensure!(tensor.size() == shape, "tensor {name} has shape {:?}, expected {shape:?}", tensor.size());
        Ok(tensor)
    }

    /// Finite numbers of `axes` axes, none of them empty, in double precision.
    pub fn with_axes(&self, name: &str, axes: usize) -> Result<Tensor> {
        let tensor = self.floats(name)?;
        ensure!(
            tensor.dim() == axes && tensor.numel() > 0,
            "tensor {name} has shape {:?}, expected {axes} axes and no empty one",
            tensor.size()
        );
        Ok(tensor)
    }

    /// A single number that may be NaN.
    pub fn number_or_nan(&self, name: &str) -> Result<f64> {
        let tensor = self.floats_or_nan(name)?;
        ensure!(tensor.dim() == 0, "tensor {name} has shape {:?}, expected a single number", tensor.size());
        Ok(tensor.double_value(&[]))
    }

    fn floats_or_nan(&self, name: &str) -> Result<Tensor> {
        let array = self.array(name)?;
        let ArrayValues::Floats(values) = &array.values else { anyhow::bail!("tensor {name} does not hold floats") };
        let shape: Vec<i64> = array.shape.iter().map(|&n| n as i64).collect();
        Ok(Tensor::from_slice(values).reshape(shape))
    }

    /// A seed: a single integer that is not negative.
    pub fn seed(&self, name: &str) -> Result<u64> {
        let array = self.array(name)?;
        let ArrayValues::Integers(values) = &array.values else {
            anyhow::bail!("tensor {name} does not hold integers")
        };
        ensure!(array.shape.is_empty(), "tensor {name} has shape {:?}, expected a single number", array.shape);
        u64::try_from(values[0]).with_context(|| format!("tensor {name} is negative"))
    }

    /// A list of texts.
    pub fn texts(&self, name: &str) -> Result<&[String]> {
        let array = self.array(name)?;
        let ArrayValues::Texts(values) = &array.values else { anyhow::bail!("tensor {name} does not hold texts") };
        ensure!(array.shape.len() == 1, "tensor {name} has shape {:?}, expected a list", array.shape);
        Ok(values)
    }

    /// A list of `name=number` texts.
    pub fn assignments(&self, name: &str) -> Result<BTreeMap<&str, f64>> {
        let mut numbers = BTreeMap::new();
        for text in self.texts(name)? {
            let (key, value) = text.split_once('=').with_context(|| format!("tensor {name}: {text:?} has no ="))?;
            let value: f64 = value.parse().with_context(|| format!("tensor {name}: {text:?} is no number"))?;
            ensure!(value.is_finite(), "tensor {name}: {text:?} is not finite");
            ensure!(numbers.insert(key, value).is_none(), "tensor {name}: {key} stands twice");
        }
        Ok(numbers)
    }

    /// # Errors
    /// An array that the file's case has not looked at: it would be skipped in silence.
    pub fn ensure_all_looked_at(&self) -> Result<()> {
        let looked_at = self.looked_at.borrow();
        match self.arrays.keys().find(|name| !looked_at.contains(*name)) {
            Some(name) => anyhow::bail!("tensor {name} is not one that this kind of file has"),
            None => Ok(()),
        }
    }
}

/// Flattened as golden files store a gradient or a variable: whole, or every 97th element of a large one.
pub fn as_stored(values: &Tensor) -> Tensor {
    let flat = values.reshape([-1]);
    if flat.numel() as i64 > STORED_WHOLE { flat.slice(0, 0, None, STRIDE) } else { flat }
}
