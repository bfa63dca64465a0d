//! The paper's network at its full size as PyTorch exports it, and PyTorch's own forces: `tests/data/pytorch/parity.*`, made by
//! `tests/python/parity_reference.py`.
#![allow(dead_code, unreachable_pub)]

use std::path::PathBuf;

use super::root::ROOT;
use safetensors::SafeTensors;

/// Frames in a window.
pub const WINDOW: usize = 64;
/// Taxels in a frame.
pub const TAXELS: usize = 16;
/// Joints in a frame.
pub const JOINTS: usize = 4;

/// Input of the network, and PyTorch's float32 output.
pub struct Parity {
    /// The export.
    pub model: PathBuf,
    /// Taxels of frames at 100 Hz, `[frames, TAXELS]`.
    pub tactile_frames: Vec<f32>,
    /// Joint angles of the frames, `[frames, JOINTS]`.
    pub joint_frames: Vec<f32>,
    /// Force of each window that the frames fill.
    pub force: Vec<f32>,
    /// Its base force.
    pub base: Vec<f32>,
}

impl Parity {
    /// Reads it.
    pub fn read() -> Self {
        let folder = PathBuf::from(format!("{ROOT}/tests/data/pytorch"));
        let bytes = std::fs::read(folder.join("parity.safetensors")).unwrap();
        let tensors = SafeTensors::deserialize(&bytes).unwrap();
        let values = |name: &str| -> Vec<f32> {
            let data = tensors.tensor(name).unwrap().data();
            data.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
        };
        let parity = Parity {
            model: folder.join("parity.onnx"),
            tactile_frames: values("tactile_frames"),
            joint_frames: values("joint_frames"),
            force: values("force"),
            base: values("force_base"),
        };
        assert_eq!(parity.tactile_frames.len(), (parity.n() + WINDOW - 1) * TAXELS);
        parity
    }

    /// Number of windows.
    pub fn n(&self) -> usize {
        self.force.len()
    }

    /// Number of frames.
    pub fn n_frames(&self) -> usize {
        self.tactile_frames.len() / TAXELS
    }

    /// Taxels of all windows, `[n, WINDOW, TAXELS]`.
    pub fn tactile(&self) -> Vec<f32> {
        windows(&self.tactile_frames, TAXELS, self.n())
    }

    /// Joint angles of all windows, `[n, WINDOW, JOINTS]`.
    pub fn pose(&self) -> Vec<f32> {
        windows(&self.joint_frames, JOINTS, self.n())
    }
}

fn windows(frames: &[f32], width: usize, n: usize) -> Vec<f32> {
    (0..n).flat_map(|start| frames[start * width..(start + WINDOW) * width].iter().copied()).collect()
}
