"""Rotations by the dozen: what `kernels.rigid` does to one, done to N at once."""

import numpy as np

from services.kernels.rigid import FloatArray


def exps(w: FloatArray) -> FloatArray:
    """Rotate by each of (N, 3) vectors, rad: Rodrigues' formula, (N, 3, 3)."""
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    W = _crosses(w)
    half_sinc = np.sinc(angle / (2 * np.pi))
    R: FloatArray = np.eye(3) + np.sinc(angle / np.pi) * W + 0.5 * half_sinc**2 * (W @ W)
    return R


def logs(R: FloatArray) -> FloatArray:
    """Return the (N, 3) rotation vectors of (N, 3, 3), lengths in [0, pi]; undoes `exps`.

    4 q q' is linear in R; its row with the largest diagonal gives q (Shepperd, 1978).
    """
    trace = np.trace(R, axis1=1, axis2=2)
    K = np.empty((len(R), 4, 4))
    K[:, 1:, 1:] = R + R.transpose(0, 2, 1)
    diagonal = 1 + 2 * np.diagonal(R, axis1=1, axis2=2) - trace[:, None]
    K[:, [1, 2, 3], [1, 2, 3]] = diagonal
    K[:, 0, 0] = 1 + trace
    K[:, 0, 1:] = R[:, [2, 0, 1], [1, 2, 0]] - R[:, [1, 2, 0], [2, 0, 1]]
    K[:, 1:, 0] = K[:, 0, 1:]
    pivot = np.argmax(np.diagonal(K, axis1=1, axis2=2), axis=1)
    q = K[np.arange(len(R)), pivot]
    q = np.where(q[:, :1] < 0, -q, q)
    length = np.linalg.norm(q[:, 1:], axis=1)
    scale = 2 * np.arctan2(length, q[:, 0]) / np.maximum(length, 1e-300)
    w: FloatArray = q[:, 1:] * scale[:, None]
    return w


def left_jacobians(w: FloatArray) -> FloatArray:
    """Return (N, 3, 3): exp(w)' = [J w'] exp(w); Taylor below 1e-4 rad, where it is exact."""
    angle = np.linalg.norm(w, axis=1)[:, None, None]
    small = angle < 1e-4
    a = np.where(small, 1.0, angle)
    once = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(a)) / a**2)
    twice = np.where(small, 1 / 6 - angle**2 / 120, (a - np.sin(a)) / a**3)
    W = _crosses(w)
    J: FloatArray = np.eye(3) + once * W + twice * (W @ W)
    return J


def _crosses(w: FloatArray) -> FloatArray:
    W = np.zeros((*w.shape[:-1], 3, 3))
    W[..., 2, 1], W[..., 0, 2], W[..., 1, 0] = w[..., 0], w[..., 1], w[..., 2]
    return W - np.swapaxes(W, -1, -2)
