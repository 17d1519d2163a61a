//! Fills a model's variables with a golden file's formula weights, and translates names and layouts.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, Result, ensure};
use paig::network::variable_names::{from_tensorflow, layout_from_tensorflow, layout_to_tensorflow};
use tch::nn::VarStore;
use tch::{Kind, Tensor};

use crate::harness::case::Case;
use crate::harness::formula;

/// A variable under both names.
#[derive(Debug)]
pub struct Variable {
    /// As the golden file spells it.
    pub original_name: String,
    pub name: String,
    pub tensor: Tensor,
}

impl Variable {
    /// Current value in TensorFlow's layout.
    pub fn in_original_layout(&self) -> Result<Tensor> {
        layout_to_tensorflow(&self.name, &self.tensor.detach())
    }

    /// Gradient in TensorFlow's layout; zero where the loss does not depend on the variable.
    pub fn gradient(&self) -> Result<Tensor> {
        let gradient = self.tensor.grad();
        let gradient = if gradient.defined() { gradient.copy() } else { self.tensor.detach().zeros_like() };
        layout_to_tensorflow(&self.name, &gradient)
    }
}

/// What a file says about its variables.
#[derive(Debug)]
pub struct VariableListing<'a> {
    /// Arrays with the names and the shapes of all variables, in the order that numbers them.
    pub names: &'a str,
    pub shapes: &'a str,
    /// Put in front of a name to make it a name of the whole model's form.
    pub prefix: &'a str,
    pub weight_seed: u64,
    /// Values of the variables without axes, by the last part of their name.
    pub scalars: BTreeMap<&'a str, f64>,
    /// Factors of some variables' weights.
    pub factors: BTreeMap<&'a str, f64>,
}

/// Sets every variable of the store by the file's formula, and gives them in the file's order.
///
/// # Errors
/// Names or shapes that are not exactly the store's.
pub fn fill(case: &Case, listing: &VariableListing, store: &VarStore) -> Result<Vec<Variable>> {
    let _guard = tch::no_grad_guard();
    let (names, shapes) = (case.golden.texts(listing.names)?, case.golden.texts(listing.shapes)?);
    ensure!(
        names.len() == shapes.len(),
        "tensor {} has {} entries, {} has {}",
        listing.shapes,
        shapes.len(),
        listing.names,
        names.len()
    );
    let mut left = store.variables();
    let known: BTreeSet<&str> = names.iter().map(String::as_str).collect();
    for factor in listing.factors.keys() {
        ensure!(known.contains(factor), "tensor scale: {factor} is not in {}", listing.names);
    }
    let mut variables = Vec::with_capacity(names.len());
    for (index, (original_name, shape)) in names.iter().zip(shapes).enumerate() {
        let name =
            from_tensorflow(&format!("{}{original_name}", listing.prefix)).with_context(|| in_array(listing.names))?;
        let mut tensor = left
            .remove(&name)
            .with_context(|| format!("{original_name} is twice there, or no variable of this model"))
            .with_context(|| in_array(listing.names))?;
        let ours = layout_to_tensorflow(&name, &tensor)?.size();
        let theirs = parse_shape(shape).with_context(|| in_array(listing.shapes))?;
        ensure!(theirs == ours, "tensor {}: {original_name} has shape {theirs:?}, ours {ours:?}", listing.shapes);
        let values = if theirs.is_empty() {
            let key = original_name.rsplit('/').next().unwrap_or_default();
            let value =
                listing.scalars.get(key).with_context(|| format!("tensor scalars has no value for {original_name}"))?;
            Tensor::from(*value as f32).to_kind(Kind::Double)
        } else {
            let factor = listing.factors.get(original_name.as_str()).copied().unwrap_or(1.0);
            formula::weights(listing.weight_seed, index, &theirs, factor)
        };
        tensor.copy_(&layout_from_tensorflow(&name, &case.taken_in(&values))?);
        variables.push(Variable { original_name: original_name.clone(), name, tensor });
    }
    let missing: BTreeSet<_> = left.into_keys().collect();
    ensure!(missing.is_empty(), "tensor {} lacks the model's {missing:?}", listing.names);
    Ok(variables)
}

fn in_array(name: &str) -> String {
    format!("tensor {name}")
}

/// `3,3,8,16`; nothing for a scalar.
fn parse_shape(text: &str) -> Result<Vec<i64>> {
    let parts = text.split(',').filter(|part| !part.is_empty());
    parts.map(|part| part.parse().with_context(|| format!("{text:?} is no shape"))).collect()
}
