"""The paper's equations, written literally and slowly: the truth that every engine is compared with.

Signs are ours (the surface shrinks); the exponent gamma is that of section 4.2 unless a name says otherwise.
"""

import itertools

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


def patch_groups(values, pilot, missing, noise, deep, side, stride, reach, members, near, loss):
    """m + C (C + Cn)^-1 (y - m) for the patches of each group, averaged (Lebrun, Buades, Morel 2013); (k, d, h, w)."""
    k, *size = values.shape
    total, weight = np.zeros_like(values), np.zeros_like(values)
    shape = (deep, side, side)
    lasts = [along - length for along, length in zip(size, shape, strict=True)]

    def at(place):
        return tuple(slice(i, i + length) for i, length in zip(place, shape, strict=True))

    def patch(a, place):
        return a[(slice(None), *at(place))].reshape(k, -1)

    def references(last):
        return [at for at in range(last + 1) if (at if 2 * at <= last else last - at) % stride == 0]

    def whole(*axes):
        return [place for place in itertools.product(*axes) if not missing[at(place)].any()]

    for middle in whole(*map(references, lasts)):
        places = whole(
            *(range(max(0, i - reach), min(last, i + reach) + 1) for i, last in zip(middle, lasts, strict=True))
        )
        far = [
            np.floor(
                1024
                * (
                    np.sum((patch(pilot, place) - patch(pilot, middle)) ** 2)
                    + near * np.sum(np.square(np.subtract(place, middle)))
                )
            )
            for place in places
        ]
        bound = np.sort(far)[min(members, len(far)) - 1]
        group = [place for place, distance in zip(places, far, strict=True) if distance <= bound]
        for channel in range(k) if len(group) > 1 else ():
            p, y = (np.array([patch(a, place)[channel] for place in group]) for a in (pilot, values))
            covariance = np.cov(p.T)
            filter_ = covariance @ np.linalg.inv(covariance + loss * noise)
            much = 1 / (np.sum(filter_**2) / len(covariance) + 1 / len(group))
            for place, one in zip(group, p.mean(0) + (y - p.mean(0)) @ filter_.T, strict=True):
                total[channel][at(place)] += much * one.reshape(shape)
                weight[channel][at(place)] += much
    return np.where(weight > 0, total / np.where(weight > 0, weight, 1), pilot)


# --- the systems that the paper cites, by their finite differences: one channel, spacing 1, no missing samples ------------------


def near(u, r, c, down, right):
    """A neighbour's value; the sample's own beyond the border."""
    h, w = u.shape
    i, j = r + down, c + right
    return u[i, j] if 0 <= i < h and 0 <= j < w else u[r, c]


def differences(u, r, c):
    """u_x, u_y, u_xx, u_xy, u_yy by central differences, y downwards."""

    def at(down, right):
        return near(u, r, c, down, right)

    x, y = (at(0, 1) - at(0, -1)) / 2, (at(1, 0) - at(-1, 0)) / 2
    xx, yy = at(0, 1) - 2 * at(0, 0) + at(0, -1), at(1, 0) - 2 * at(0, 0) + at(-1, 0)
    return x, y, xx, (at(1, 1) - at(1, -1) - at(-1, 1) + at(-1, -1)) / 4, yy


def each(rate):
    """A rate of single samples as one of all."""

    def of_all(u, *arguments):
        h, w = u.shape
        return np.array([[rate(u, r, c, *arguments) for c in range(w)] for r in range(h)])

    return of_all


def xi_xi(u, r, c):
    """(u_xx u_y^2 - 2 u_x u_y u_xy + u_yy u_x^2) / |grad u|^2; half the Laplacian where the gradient is zero."""
    x, y, xx, xy, yy = differences(u, r, c)
    return (xx * y**2 - 2 * x * y * xy + yy * x**2) / (x**2 + y**2) if x**2 + y**2 > 1e-24 else (xx + yy) / 2


@each
def selective_smoothing(u, r, c, smooth, contrast):
    """[ALM92]: g(|grad G u|) |grad u| div(grad u / |grad u|)."""
    x, y, *_ = differences(smooth, r, c)
    return xi_xi(u, r, c) / (1 + contrast**2 * (x**2 + y**2))


@each
def shock_filter(u, r, c, start, smooth, contrast, fidelity, shock, switch=0.0):
    """[KDA97]: phi'(s)/s u_xi_xi + h phi''(s) u_eta_eta - lambda (u - u0) - (1 - h) beta sign(G u_eta_eta) |grad u|.

    h is 1 where |grad G u| is below the switch and 0 elsewhere; without a switch both stand.
    """
    x, y, xx, _, yy = differences(u, r, c)
    s2 = contrast**2 * (x**2 + y**2)
    along = xi_xi(u, r, c)
    bx, by, bxx, _, byy = differences(smooth, r, c)
    h = 1.0 if switch == 0 or np.hypot(bx, by) < switch else 0.0
    rate = along / (1 + s2) ** 0.5 + h * (xx + yy - along) / (1 + s2) ** 1.5 - fidelity * (u[r, c] - start[r, c])
    square = 0.0
    for down, right in ((0, 1), (1, 0)):
        back, forth = u[r, c] - near(u, r, c, -down, -right), near(u, r, c, down, right) - u[r, c]
        square += min(abs(back), abs(forth)) ** 2 if back * forth > 0 else 0.0
    shock = shock if switch == 0 else (1.0 - h) * shock
    return rate - shock * np.sign(bxx + byy - xi_xi(smooth, r, c)) * square**0.5


@each
def min_max(u, r, c, radius):
    """[MS96]: max(kappa, 0) |grad u| where the mean over a disc is below the threshold, else min(kappa, 0) |grad u|."""
    h, w = u.shape
    far = int(np.ceil(radius))
    disc = [(i, j) for i in range(-far, far + 1) for j in range(-far, far + 1) if i**2 + j**2 <= radius**2]
    mean = np.mean([u[min(max(r + i, 0), h - 1), min(max(c + j, 0), w - 1)] for i, j in disc])
    x, y, *_ = differences(u, r, c)
    length = np.hypot(x, y)
    right, down = (int(np.rint(-y * radius / length)), int(np.rint(x * radius / length))) if length > 0 else (0, 0)
    far = int(np.rint(radius))
    ways = [(down, right)] if length > 0 else [(0, far), (far, 0)]
    ends = [u[min(max(r + s * i, 0), h - 1), min(max(c + s * j, 0), w - 1)] for i, j in ways for s in (1, -1)]
    motion = xi_xi(u, r, c)
    return max(motion, 0.0) if mean < np.mean(ends) else min(motion, 0.0)


@each
def in_range(u, r, c, rate, fastest, start=None):
    """The rate with which an explicit step of 2 / fastest stays between the neighbours, and the start where that pulls."""
    around = [near(u, r, c, i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    around += [] if start is None else [start[r, c]]
    return min(max(rate[r, c], (min(around) - u[r, c]) * fastest / 2), (max(around) - u[r, c]) * fastest / 2)


def over_links(u, conductance):
    """The sum over four neighbours of the mean conductance of both ends times the difference."""
    h, w = u.shape
    rate = np.zeros_like(u)
    for r in range(h):
        for c in range(w):
            for i, j in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
                if 0 <= i < h and 0 <= j < w:
                    rate[r, c] += 0.5 * (conductance[r, c] + conductance[i, j]) * (u[i, j] - u[r, c])
    return rate


def low_curvature(u, contrast):
    """[TT99]: -div(C(m) grad(laplace u)), m^2 = (u_xx^2 + u_yy^2) / 2 + u_xy^2, C = 1 / (1 + (contrast m)^2)."""
    h, w = u.shape
    laplacian, conductance = np.zeros_like(u), np.zeros_like(u)
    for r in range(h):
        for c in range(w):
            _, _, xx, xy, yy = differences(u, r, c)
            laplacian[r, c] = xx + yy
            conductance[r, c] = 1 / (1 + contrast**2 * (0.5 * (xx**2 + yy**2) + xy**2))
    return -over_links(laplacian, conductance)


def edge_field(u, contrast, rho, power):
    """[Sha96]: v with rho laplace v + (1 - v) / rho = 2 v S / rho, S = (contrast |grad u|)^power, by a dense system."""
    h, w = u.shape
    matrix = np.zeros((h * w, h * w))
    for r in range(h):
        for c in range(w):
            x, y, *_ = differences(u, r, c)
            matrix[r * w + c, r * w + c] += 1 / rho + 2 * (contrast * np.hypot(x, y)) ** power / rho
            for i, j in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
                if 0 <= i < h and 0 <= j < w:
                    matrix[r * w + c, r * w + c] += rho
                    matrix[r * w + c, i * w + j] -= rho
    return np.linalg.solve(matrix, np.full(h * w, 1 / rho)).reshape(h, w)


def ring(points, shape):
    """(14) as printed: 1/(2 A) sum (cot alpha_ij + cot beta_ij) (X_j - X_i) over the ring of eight triangles, inner samples."""
    h, w = shape
    at = points.reshape(h, w, -1)
    rate = np.zeros((h, w, points.shape[1]))
    around = [(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)]
    for r in range(1, h - 1):
        for c in range(1, w - 1):
            x, ends = at[r, c], [at[r + i, c + j] for i, j in around]
            area = sum(triangle_area(x, ends[k], ends[(k + 1) % 8]) for k in range(8))
            for k in range(8):
                before, end, behind = ends[k - 1], ends[k], ends[(k + 1) % 8]
                cots = angle_cotangent(x - before, end - before) + angle_cotangent(x - behind, end - behind)
                rate[r, c] += cots * (end - x) / (2 * area)
    return rate


def conducting(points, values, faces, g):
    """div(g(|grad u|) grad u) on triangles of the plane: -grad_i of sum A phi over a third of the area around i; (n, k)."""
    rate, third = np.zeros_like(values), np.zeros(len(points))
    for i, j, k in faces:
        corners = np.column_stack([np.ones(3), points[[i, j, k]]])
        slopes = np.linalg.inv(corners)[1:]  # the gradients of the hat functions
        area = abs(np.linalg.det(corners)) / 2
        gradient = slopes @ values[[i, j, k]]
        rate[[i, j, k]] -= area * g(np.sum(gradient**2)) * slopes.T @ gradient
        third[[i, j, k]] += area / 3
    return rate / third[:, None]


def graph_motion(values, h):
    """g^ij d_i d_j I^a of several channels (h, w, k) by central differences, inner samples: the graph moves by its curvature."""
    inner = (slice(1, -1), slice(1, -1))
    x, y = (values[1:-1, 2:] - values[1:-1, :-2]) / (2 * h), (values[2:, 1:-1] - values[:-2, 1:-1]) / (2 * h)
    xx = (values[1:-1, 2:] - 2 * values[inner] + values[1:-1, :-2]) / h**2
    yy = (values[2:, 1:-1] - 2 * values[inner] + values[:-2, 1:-1]) / h**2
    xy = (values[2:, 2:] - values[2:, :-2] - values[:-2, 2:] + values[:-2, :-2]) / (4 * h**2)
    e, f, g = 1 + (x * x).sum(-1), (x * y).sum(-1), 1 + (y * y).sum(-1)
    e, f, g = (part[..., None] for part in (e, f, g))
    return (g * xx - 2 * f * xy + e * yy) / (e * g - f**2)
