//! Source images: two MNIST digits, and CIFAR-10 pictures that lie behind digits or balls.
//!
//! The original's three images come with the crate (`data/assets/mnist_cifar_assets.npz`); others are read from MNIST's
//! IDX and CIFAR-10's binary files.

use std::io::{Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use image::imageops::FilterType;
use ndarray::{Array2, Array3, Array4, ArrayView3, Axis};
use ndarray_npy::NpzReader;

use super::variant::Variant;
use crate::support::{picture_file, storage};

/// Side of an MNIST image, pixels.
pub const DIGIT_SIDE: usize = 28;
/// Side of a CIFAR-10 image, pixels.
pub const PICTURE_SIDE: usize = 32;
/// Bytes of an image in CIFAR-10's binary files: a label, then the image channel by channel.
const PICTURE_RECORD: usize = 1 + 3 * PICTURE_SIDE * PICTURE_SIDE;
/// Training files of CIFAR-10, numbered from 1.
const PICTURE_FILES: usize = 5;
/// Images in each of CIFAR-10's five training files.
const PICTURES_A_FILE: usize = 10_000;
/// First bytes of an IDX file of unsigned bytes in three dimensions.
const IDX_IMAGES: [u8; 4] = [0, 0, 8, 3];

const ASSETS: &[u8] = include_bytes!("../../data/assets/mnist_cifar_assets.npz");

/// Grey levels 0..255.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceImages {
    /// Two digits, `[28, 28]`; digit j is drawn in channel j.
    pub digits: [Array2<u8>; 2],
    /// What may lie behind the objects, `[pictures, side, side, 3]`; CIFAR-10's have a side of 32.
    pub pictures: Array4<u8>,
}

impl SourceImages {
    /// The original's: MNIST training images 0 and 1, CIFAR-10 training image 1.
    ///
    /// # Errors
    /// A crate built with a damaged asset file.
    pub fn original() -> Result<Self> {
        let read = || -> Result<Self> {
            let mut npz = NpzReader::new(Cursor::new(ASSETS))?;
            let digits: Array3<u8> = npz.by_name("mnist_train_0_1")?;
            let picture: Array3<u8> = npz.by_name("cifar10_train_1")?;
            ensure!(digits.dim() == (2, DIGIT_SIDE, DIGIT_SIDE), "the digits have shape {:?}", digits.dim());
            ensure!(picture.dim() == (PICTURE_SIDE, PICTURE_SIDE, 3), "the picture has shape {:?}", picture.dim());
            let digit = |j| digits.index_axis(ndarray::Axis(0), j).to_owned();
            Ok(Self { digits: [digit(0), digit(1)], pictures: picture.insert_axis(Axis(0)) })
        };
        read().context("the built-in data/assets/mnist_cifar_assets.npz is damaged; restore it and build again")
    }

    /// Those of a scene: the original's, and the picture that the scene names as its background.
    ///
    /// # Errors
    /// The picture cannot be read.
    pub fn of(variant: &Variant) -> Result<Self> {
        let background = variant.background_look();
        match &background.file {
            Some(file) => Self::original()?.with_picture(file, variant.side),
            None => Self::original(),
        }
    }

    /// Replaces the picture by a PNG or JPEG file, scaled to a square of `side` pixels.
    ///
    /// # Errors
    /// No such file, or neither of both.
    pub fn with_picture(mut self, file: &Path, side: usize) -> Result<Self> {
        let picture = picture_file::read(file)?;
        let scaled = picture.resize_exact(side as u32, side as u32, FilterType::Triangle).into_rgb8();
        self.pictures = Array4::from_shape_vec((1, side, side, 3), scaled.into_raw())?;
        Ok(self)
    }

    /// Replaces the digits by training images `indices` (from 0) of the MNIST folder `folder`, which holds
    /// `train-images-idx3-ubyte`, uncompressed.
    ///
    /// # Errors
    /// No such file, not an IDX file of 28 x 28 images, or an index past its end.
    pub fn with_mnist(mut self, folder: &Path, indices: [usize; 2]) -> Result<Self> {
        let names = ["train-images-idx3-ubyte", "train-images.idx3-ubyte"];
        let path = existing(folder, &names).context("no MNIST training images")?;
        for (digit, index) in self.digits.iter_mut().zip(indices) {
            *digit = read_idx_image(&path, index).with_context(|| format!("cannot read image {index} of {path:?}"))?;
        }
        Ok(self)
    }

    /// Replaces the picture by training image `index` (from 0) of the CIFAR-10 folder `folder`, which holds the
    /// binary version's `data_batch_1.bin` to `data_batch_5.bin`.
    ///
    /// # Errors
    /// No such file, or an index past the end.
    pub fn with_cifar(mut self, folder: &Path, index: usize) -> Result<Self> {
        let path = cifar_file(folder, index / PICTURES_A_FILE + 1)?;
        let picture = read_cifar_image(&path, index % PICTURES_A_FILE)
            .with_context(|| format!("cannot read image {index} from {path:?}"))?;
        self.pictures = picture.insert_axis(Axis(0));
        Ok(self)
    }

    /// Replaces the picture by all training images of such a folder.
    ///
    /// # Errors
    /// One of the five files is missing, or is no whole number of images.
    pub fn with_all_cifar(mut self, folder: &Path) -> Result<Self> {
        let mut pixels = Vec::new();
        for number in 1..=PICTURE_FILES {
            let path = cifar_file(folder, number)?;
            let records = storage::read(&path).with_context(|| format!("cannot read {path:?}"))?;
            ensure!(
                !records.is_empty() && records.len().is_multiple_of(PICTURE_RECORD),
                "{path:?} has {} bytes, not a whole number of CIFAR-10's records of {PICTURE_RECORD}; it is incomplete, \
                 or another file",
                records.len()
            );
            for record in records.chunks_exact(PICTURE_RECORD) {
                pixels.extend(cifar_image(&record[1..])?);
            }
        }
        let pictures = pixels.len() / (PICTURE_RECORD - 1);
        self.pictures = Array4::from_shape_vec((pictures, PICTURE_SIDE, PICTURE_SIDE, 3), pixels)?;
        Ok(self)
    }
}

/// Training file `number` (from 1) of a CIFAR-10 folder.
fn cifar_file(folder: &Path, number: usize) -> Result<PathBuf> {
    existing(folder, &[&format!("data_batch_{number}.bin")]).context("no CIFAR-10 training images (binary version)")
}

/// The first of these files that is there.
fn existing(folder: &Path, names: &[&str]) -> Result<PathBuf> {
    let found = names.iter().map(|name| folder.join(name)).find(|path| path.is_file());
    found.with_context(|| {
        format!("folder {folder:?} has no file {}; download it there and unpack it (no .gz)", names.join(" or "))
    })
}

fn read_idx_image(path: &Path, index: usize) -> Result<Array2<u8>> {
    let mut file = storage::open(path)?;
    let mut header = [0; 16];
    file.read_exact(&mut header).context("the file is shorter than an IDX header")?;
    ensure!(header[..4] == IDX_IMAGES, "not an IDX image file: it starts with {:?}, not {IDX_IMAGES:?}", &header[..4]);
    let size = |field: usize| {
        let bytes = &header[4 * field..4 * field + 4];
        bytes.iter().fold(0, |value, byte| value << 8 | usize::from(*byte))
    };
    let (count, rows, columns) = (size(1), size(2), size(3));
    ensure!((rows, columns) == (DIGIT_SIDE, DIGIT_SIDE), "images of {rows} x {columns}, expected 28 x 28");
    ensure!(index < count, "the file has {count} images: 0 to {}", count.saturating_sub(1));
    let pixels = read_at(&mut file, header.len() + index * rows * columns, rows * columns)?;
    Ok(Array2::from_shape_vec((rows, columns), pixels)?)
}

fn read_cifar_image(path: &Path, index: usize) -> Result<Array3<u8>> {
    let mut file = storage::open(path)?;
    cifar_image(&read_at(&mut file, index * PICTURE_RECORD + 1, PICTURE_RECORD - 1)?)
}

/// From channel by channel to `[32, 32, 3]`.
fn cifar_image(planes: &[u8]) -> Result<Array3<u8>> {
    let planes = ArrayView3::from_shape((3, PICTURE_SIDE, PICTURE_SIDE), planes)?;
    Ok(planes.permuted_axes([1, 2, 0]).as_standard_layout().into_owned())
}

fn read_at(file: &mut (impl Read + Seek), offset: usize, length: usize) -> Result<Vec<u8>> {
    file.seek(SeekFrom::Start(offset as u64))?;
    let mut bytes = vec![0; length];
    match file.read_exact(&mut bytes) {
        Ok(()) => Ok(bytes),
        Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            bail!("the file ends before byte {}; it is incomplete, or the index too large", offset + length)
        }
        Err(error) => Err(error.into()),
    }
}
