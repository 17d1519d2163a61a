//! Names and layouts of the original's variables, and ours: the one place where they are translated.
//!
//! | TensorFlow | here | TensorFlow's layout | ours |
//! |---|---|---|---|
//! | `net/encoder/conv2d_3/kernel` | `encoder.conv2d_3.weight` | `[kh, kw, in, out]` | `[out, in, kh, kw]` |
//! | `net/encoder/dense/kernel` | `encoder.dense.weight` | `[in, out]` | `[out, in]` |
//! | `net/encoder/dense/bias` | `encoder.dense.bias` | `[out]` | `[out]` |
//! | `net/spring_ode_cell/log_k` | `spring_ode_cell.log_k` | `[]` | `[]` |
//!
//! Both directions are strict: a name that does not have one of these forms is an error, never guessed at.

use anyhow::{Context, Result, bail, ensure};
use tch::Tensor;

/// The scope under which the original keeps all variables of its network.
const ROOT: &str = "net";

/// Our name of a variable of the original, `net/<scope>/<layer>/<kernel|bias>` or `net/<scope>/<scalar>`.
///
/// # Errors
/// A name of another form.
pub fn from_tensorflow(name: &str) -> Result<String> {
    let form = || format!("{name:?} is not a variable of the original (net/<scope>/<layer>/<kernel|bias>)");
    let parts: Vec<&str> = name.split('/').collect();
    match parts[..] {
        [ROOT, scope, layer, leaf] if is_word(scope) && is_layer(layer) => {
            let leaf = match leaf {
                "kernel" => "weight",
                "bias" => "bias",
                _ => bail!(form()),
            };
            Ok(format!("{scope}.{layer}.{leaf}"))
        }
        [ROOT, scope, scalar] if is_word(scope) && is_scalar(scalar) => Ok(format!("{scope}.{scalar}")),
        _ => bail!(form()),
    }
}

/// The original's name of one of our variables; the inverse of [`from_tensorflow`].
///
/// # Errors
/// A name that is neither `<scope>.<layer>.<weight|bias>` nor `<scope>.<scalar>`.
pub(crate) fn to_tensorflow(name: &str) -> Result<String> {
    let form = || format!("{name:?} is not a variable of a model (<scope>.<layer>.<weight|bias>)");
    let parts: Vec<&str> = name.split('.').collect();
    match parts[..] {
        [scope, layer, leaf] if is_word(scope) && is_layer(layer) => {
            let leaf = match leaf {
                "weight" => "kernel",
                "bias" => "bias",
                _ => bail!(form()),
            };
            Ok(format!("{ROOT}/{scope}/{layer}/{leaf}"))
        }
        [scope, scalar] if is_word(scope) && is_scalar(scalar) => Ok(format!("{ROOT}/{scope}/{scalar}")),
        _ => bail!(form()),
    }
}

/// Values in TensorFlow's layout to ours; `name` is our name and says which kind of variable it is.
///
/// # Errors
/// A rank that the kind of variable cannot have.
pub fn layout_from_tensorflow(name: &str, values: &Tensor) -> Result<Tensor> {
    permuted(name, values, [3, 2, 0, 1])
}

/// Values in our layout to TensorFlow's; the inverse of [`layout_from_tensorflow`].
///
/// # Errors
/// A rank that the kind of variable cannot have.
pub fn layout_to_tensorflow(name: &str, values: &Tensor) -> Result<Tensor> {
    permuted(name, values, [2, 3, 1, 0])
}

fn permuted(name: &str, values: &Tensor, convolution: [i64; 4]) -> Result<Tensor> {
    let leaf = name.rsplit('.').next().context("a name has a last part")?;
    let allowed: &[usize] = match leaf {
        "weight" => &[2, 4],
        "bias" => &[1],
        _ => &[0],
    };
    ensure!(allowed.contains(&values.dim()), "variable {name} has an impossible shape {:?}", values.size());
    Ok(match values.dim() {
        4 => values.permute(convolution).contiguous(),
        2 => values.transpose(0, 1).contiguous(),
        _ => values.shallow_clone(),
    })
}

fn is_word(part: &str) -> bool {
    part.starts_with(|c: char| c.is_ascii_lowercase())
        && part.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}

/// `conv2d`, `conv2d_1`, .., `dense`, `dense_1`, ..: as [`crate::network::blocks::Layers`] numbers them.
fn is_layer(part: &str) -> bool {
    let number = match part.strip_prefix("conv2d").or_else(|| part.strip_prefix("dense")) {
        Some("") => return true,
        Some(rest) => rest.strip_prefix('_').unwrap_or_default(),
        None => return false,
    };
    // No leading zero: `dense_0` and `dense_01` are names that TensorFlow never gives.
    !number.is_empty() && !number.starts_with('0') && number.chars().all(|c| c.is_ascii_digit())
}

/// The logarithms that stand alone in a scope.
fn is_scalar(part: &str) -> bool {
    part == "logsigma" || part.strip_prefix("log_").is_some_and(is_word)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAIRS: [(&str, &str); 5] = [
        ("net/encoder/conv2d/kernel", "encoder.conv2d.weight"),
        ("net/encoder/conv2d_12/bias", "encoder.conv2d_12.bias"),
        ("net/init_vel/dense_1/kernel", "init_vel.dense_1.weight"),
        ("net/decoder/logsigma", "decoder.logsigma"),
        ("net/spring_ode_cell/log_k", "spring_ode_cell.log_k"),
    ];

    #[test]
    fn names_translate_both_ways() {
        for (theirs, ours) in PAIRS {
            assert_eq!(from_tensorflow(theirs).unwrap(), ours);
            assert_eq!(to_tensorflow(ours).unwrap(), theirs);
        }
    }

    #[test]
    fn other_names_are_errors() {
        for name in [
            "",
            "net",
            "encoder/conv2d/kernel",
            "net/encoder/conv2d/weight",
            "net/encoder/conv2d_0/kernel",
            "net/encoder/conv2d_/kernel",
            "net/encoder/conv3d/kernel",
            "net/encoder/dense/kernel:0",
            "net/encoder/dense/kernel/RMSProp",
            "net//dense/kernel",
            "net/decoder/sigma",
        ] {
            let message = from_tensorflow(name).unwrap_err().to_string();
            assert!(message.contains(name), "{message}");
        }
        for name in ["", "encoder", "encoder.conv2d.kernel", "encoder.conv2d", "encoder.dense__1.weight"] {
            assert!(to_tensorflow(name).is_err(), "{name}");
        }
    }

    #[test]
    fn layouts_translate_both_ways() {
        let kernel = Tensor::arange(2 * 3 * 4 * 5, (tch::Kind::Float, tch::Device::Cpu)).reshape([2, 3, 4, 5]);
        let ours = layout_from_tensorflow("a.conv2d.weight", &kernel).unwrap();
        assert_eq!(ours.size(), [5, 4, 2, 3]);
        assert_eq!(ours.double_value(&[4, 3, 1, 2]), kernel.double_value(&[1, 2, 3, 4]));
        assert!(layout_to_tensorflow("a.conv2d.weight", &ours).unwrap().equal(&kernel));
        let dense = kernel.reshape([6, 20]);
        let ours = layout_from_tensorflow("a.dense.weight", &dense).unwrap();
        assert_eq!(ours.double_value(&[7, 3]), dense.double_value(&[3, 7]));
        assert!(layout_to_tensorflow("a.dense.weight", &ours).unwrap().equal(&dense));
        assert!(layout_from_tensorflow("a.dense.bias", &dense).is_err());
        assert!(layout_from_tensorflow("a.log_k", &dense).is_err());
    }
}
