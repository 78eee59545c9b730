"""Splitting every triangle in four, in its plane or towards a smooth surface."""

import numpy as np
from numpy.typing import NDArray

Vertices = NDArray[np.float64]
Faces = NDArray[np.int64]


def split(vertices: Vertices, faces: Faces) -> tuple[Vertices, Faces]:
    """Split every triangle at its edges' middles; the surface stays the same point set."""
    edges, edge_of_face = _edges(faces)
    middles = vertices[edges].mean(axis=1)
    return np.concatenate([vertices, middles]), _four(faces, edge_of_face + len(vertices))


def loop(vertices: Vertices, faces: Faces) -> tuple[Vertices, Faces]:
    """Split every triangle and smooth: one step of Loop's scheme for closed surfaces.

    Source: C. Loop, Smooth Subdivision Surfaces Based on Triangles, 1987; new points 3/8 3/8 1/8
    1/8, old points by beta(valence).
    """
    edges, edge_of_face = _edges(faces)
    # The corner opposite to edge k of a face is corner k + 2.
    opposite = np.zeros((len(edges), 3))
    np.add.at(opposite, edge_of_face.reshape(-1), vertices[np.roll(faces, 1, axis=1).reshape(-1)])
    odd = 0.375 * vertices[edges].sum(axis=1) + 0.125 * opposite

    valence = np.bincount(edges.reshape(-1), minlength=len(vertices))
    ring = np.zeros_like(vertices)
    np.add.at(ring, edges[:, 0], vertices[edges[:, 1]])
    np.add.at(ring, edges[:, 1], vertices[edges[:, 0]])
    beta = (0.625 - (0.375 + 0.25 * np.cos(2 * np.pi / valence)) ** 2) / valence
    even = (1 - valence * beta)[:, None] * vertices + beta[:, None] * ring
    return np.concatenate([even, odd]), _four(faces, edge_of_face + len(vertices))


def _edges(faces: Faces) -> tuple[Faces, Faces]:
    """Number the undirected edges: (E, 2) ends, (F, 3) the edge from corner k to corner k + 1."""
    directed = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, edge_of_face = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True)
    return edges, edge_of_face.reshape(-1, 3)


def _four(corners: Faces, middles: Faces) -> Faces:
    (a, b, c), (ab, bc, ca) = corners.T, middles.T
    rows = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(row, axis=1) for row in rows])
