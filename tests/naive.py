"""The paper's equations, written literally and slowly: the truth that every engine is compared with.

Signs are ours (the surface shrinks); the exponent gamma is that of section 4.2 unless a name says otherwise.
"""

import numpy as np


def perona_malik(image, alpha):
    """(1): div(g(|grad I|) grad I), g(x) = 1 / (1 + x^2 / alpha), four neighbours, no flux across the border."""
    h, w = image.shape
    rate = np.zeros_like(image)
    for r in range(h):
        for c in range(w):
            for i, j in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
                if 0 <= i < h and 0 <= j < w:
                    step = image[i, j] - image[r, c]
                    rate[r, c] += step / (1 + step**2 / alpha)
    return rate


def twice_mean_curvature(image, h):
    """kappa of section 5.1 by central differences, inner samples: it lacks the 1/2, so it is twice the mean curvature."""
    inner = (slice(1, -1), slice(1, -1))
    gy, gx = (image[2:, 1:-1] - image[:-2, 1:-1]) / (2 * h), (image[1:-1, 2:] - image[1:-1, :-2]) / (2 * h)
    xx = (image[1:-1, 2:] - 2 * image[inner] + image[1:-1, :-2]) / h**2
    yy = (image[2:, 1:-1] - 2 * image[inner] + image[:-2, 1:-1]) / h**2
    xy = (image[2:, 2:] - image[2:, :-2] - image[:-2, 2:] + image[:-2, :-2]) / (4 * h**2)
    w = np.sqrt(1 + gx**2 + gy**2)  # (2)
    return (xx * (1 + gy**2) - 2 * xy * gx * gy + yy * (1 + gx**2)) / w**3, w


def flow_of_section_3(image, h, gamma3):
    """(7): I_t = 2 kappa / W^gamma; gamma3 = -1 is (6), 0 is [FEF98], 1 is the Beltrami flow."""
    kappa, w = twice_mean_curvature(image, h)
    return kappa / w**gamma3


def angle_cotangent(u, v):
    """cot(u, v) = u.v / sqrt(|u|^2 |v|^2 - (u.v)^2), section 5.4.2."""
    dot = sum(a * b for a, b in zip(u, v, strict=True))
    return dot / np.sqrt(sum(a * a for a in u) * sum(b * b for b in v) - dot**2)


def triangle_area(p, q, r):
    """Half of sqrt(|u|^2 |v|^2 - (u.v)^2), section 5.4.1."""
    u, v = q - p, r - p
    return 0.5 * np.sqrt((u @ u) * (v @ v) - (u @ v) ** 2)


def area_gradient(points, faces):
    """(13): grad A = 1/2 sum (cot alpha_ij + cot beta_ij) (X_i - X_j)."""
    gradient = np.zeros_like(points)
    for face in faces:
        for turn in range(3):
            i, j, k = np.roll(face, turn)
            cot = angle_cotangent(points[i] - points[k], points[j] - points[k])
            gradient[i] += 0.5 * cot * (points[i] - points[j])
            gradient[j] += 0.5 * cot * (points[j] - points[i])
    return gradient


def conormals(points, sheets):
    """Half the outward conormal times the length of each boundary edge, at both its ends."""
    pull = np.zeros_like(points)
    for faces in sheets:
        edges = {}
        for face in faces:
            for turn in range(3):
                i, j, k = np.roll(face, turn)
                edges.setdefault(frozenset((i, j)), []).append((i, j, k))
        for (i, j, k), *others in edges.values():
            if not others:
                along = (points[j] - points[i]) / np.linalg.norm(points[j] - points[i])
                inward = points[k] - points[i]
                inward = inward - (inward @ along) * along
                outward = -inward / np.linalg.norm(inward) * np.linalg.norm(points[j] - points[i])
                pull[i] += 0.5 * outward
                pull[j] += 0.5 * outward
    return pull


def areas(points, faces, mass):
    """Barycentric mass (n,), a third of the area around each vertex, or the whole ring as (14)."""
    total = np.zeros(len(points))
    for face in faces:
        for i in face:
            total[i] += triangle_area(*points[face]) / (3 if mass == "barycentric" else 1)
    return total


def rate(points, sheets, free, gamma=0.0, indicator="metric", mass="barycentric", boundary="neumann", floor=0.05):
    """(10), with B = grad A / A (12) and its projection on the free coordinates: dX/dt of them, (n, k).

    :param free: (n, d, k), orthonormal free directions of each vertex.
    """
    faces = np.concatenate(sheets)
    gradient = area_gradient(points, faces)
    if boundary == "plane-preserving":
        gradient = gradient - conormals(points, sheets)
    b = gradient / areas(points, faces, mass)[:, None]
    out = np.zeros((len(points), free.shape[2]))
    for i in range(len(points)):
        bar = free[i].T @ b[i]
        if indicator == "projection":
            s = max(np.linalg.norm(bar) / np.linalg.norm(b[i]), floor)
        else:
            across = np.eye(points.shape[1]) - free[i] @ free[i].T
            around = [face for face in faces if i in face]
            flat = sum(triangle_area(*(points[face] @ across)) for face in around)
            s = flat / sum(triangle_area(*points[face]) for face in around)
        out[i] = -(s**gamma) * bar
    return out


def graph_flow(points, faces, free):
    """(8), (9): -(B.B / Bbar.Bbar) Bbar on the free coordinates, (n, k)."""
    b = area_gradient(points, faces) / areas(points, faces, "barycentric")[:, None]
    bar = np.einsum("ndk,nd->nk", free, b)
    return -(np.square(b).sum(1) / np.square(bar).sum(1))[:, None] * bar


def stretch(slope2, q):
    """(W^2q - 1) / (W^2 - 1), W^2 = 1 + slope2: the factor of the free part of lengths for sharpness q; q where it is flat."""
    return np.expm1(q * np.log1p(slope2)) / slope2 if slope2 > 0 else q


def cotangents_of_dots(dot0, dot1, dot2, det):
    """Cotangents and area of a triangle from the inner products of the edges that leave its corners; 4 T^2 = det."""
    doubled = np.sqrt(det)
    return dot0 / doubled, dot1 / doubled, dot2 / doubled, 0.5 * doubled


def patch_groups(values, pilot, missing, noise, side, stride, reach, members, near, loss):
    """m + C (C + Cn)^-1 (y - m) for the patches of each group, averaged: Lebrun, Buades, Morel 2013, second step; (k, h, w)."""
    k, h, w = values.shape
    total, weight = np.zeros_like(values), np.zeros_like(values)

    def patch(a, r, c):
        return a[:, r : r + side, c : c + side].reshape(k, -1)

    def references(last):
        return [at for at in range(last + 1) if (at if 2 * at <= last else last - at) % stride == 0]

    def whole(r, c):
        return not missing[r : r + side, c : c + side].any()

    for r, c in ((r, c) for r in references(h - side) for c in references(w - side) if whole(r, c)):
        places = [
            (i, j)
            for i in range(max(0, r - reach), min(h - side, r + reach) + 1)
            for j in range(max(0, c - reach), min(w - side, c + reach) + 1)
            if whole(i, j)
        ]
        far = [
            np.floor(
                1024 * (np.sum((patch(pilot, i, j) - patch(pilot, r, c)) ** 2) + near * ((i - r) ** 2 + (j - c) ** 2))
            )
            for i, j in places
        ]
        bound = np.sort(far)[min(members, len(far)) - 1]
        group = [place for place, distance in zip(places, far, strict=True) if distance <= bound]
        for channel in range(k) if len(group) > 1 else ():
            p, y = (np.array([patch(a, i, j)[channel] for i, j in group]) for a in (pilot, values))
            covariance = np.cov(p.T)
            filter_ = covariance @ np.linalg.inv(covariance + loss * noise)
            much = 1 / (np.sum(filter_**2) / side**2 + 1 / len(group))
            for (i, j), one in zip(group, p.mean(0) + (y - p.mean(0)) @ filter_.T, strict=True):
                total[channel, i : i + side, j : j + side] += much * one.reshape(side, side)
                weight[channel, i : i + side, j : j + side] += much
    return np.where(weight > 0, total / np.where(weight > 0, weight, 1), pilot)
