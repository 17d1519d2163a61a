//! Structural similarity against scikit-image (tests/data/make_skimage_ssim.py made the numbers).

use std::path::Path;

use ndarray::{Array1, Array4};
use ndarray_npy::NpzReader;
use paig::evaluation::ssim::ssim;
use tch::Tensor;

#[test]
fn agrees_with_skimage() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/skimage_ssim.npz");
    let mut npz = NpzReader::new(std::fs::File::open(path).unwrap()).unwrap();
    let expected: Array1<f64> = npz.by_name("ssim").unwrap();
    let [first, second] = ["first", "second"].map(|name| {
        let images: Array4<f32> = npz.by_name(name).unwrap();
        let shape = images.shape().iter().map(|&n| n as i64).collect::<Vec<_>>();
        Tensor::from_slice(images.as_slice().unwrap()).reshape(&shape).permute([0, 3, 1, 2])
    });
    let found = Vec::<f64>::try_from(ssim(&first, &second).unwrap()).unwrap();
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(&expected) {
        assert!((found - expected).abs() < 1e-9, "{found} for {expected}");
    }
}

#[test]
fn frames_that_cannot_be_compared_are_refused() {
    let zeros = |shape: [i64; 4]| Tensor::zeros(shape, (tch::Kind::Float, tch::Device::Cpu));
    assert!(ssim(&zeros([1, 3, 32, 32]), &zeros([2, 3, 32, 32])).is_err());
    assert!(ssim(&zeros([1, 3, 10, 32]), &zeros([1, 3, 10, 32])).is_err());
}
