"""A reader of FOVEATED frames by somebody who has only read docs/formats/foveated-frame.md: NumPy
and zlib. Orthographic pictures come out byte for byte; in perspective exp and log are NumPy's, so
that a byte may differ by one."""

import dataclasses
import struct
import zlib

import numpy as np

F = np.float32


@dataclasses.dataclass
class Level:
    width: int
    rect: tuple
    crossing: tuple
    voids: int
    present: np.ndarray = None
    split: np.ndarray = None
    values: np.ndarray = None

    @property
    def shape(self):
        u0, u1, v0, v1 = self.rect
        return v1 - v0, u1 - u0


@dataclasses.dataclass
class Image:
    face: int = 0
    z0: float = 0
    p0: float = 0
    steps: tuple = ()
    sheet: tuple = ()
    levels: list = None


class Frame:
    """What the bytes hold."""

    def __init__(self, data):
        assert zlib.crc32(data[:-4]) == struct.unpack("<I", data[-4:])[0]
        (magic, version, self.perspective, self.smoothing, self.basis, self.bits, images, marked, zero,
         self.width, self.height, *rest) = struct.unpack_from("<4sBBBBBBBBII3f2d", data)
        assert (magic, version, zero) == (b"FVFR", 1, 0)
        self.background = np.array(rest[:3], F)
        self.marker = tuple(rest[3:]) if marked else None
        at = 48
        count = 12 if self.perspective else 6
        self.geometry = struct.unpack_from(f"<{count}d", data, at)
        at += 8 * count
        self.images = []
        for _ in range(images):
            image = Image(levels=[])
            if self.perspective:
                image.face, image.z0, image.p0, *image.steps = struct.unpack_from("<B7x11d", data, at)
                at += 96
            *image.sheet, levels, log2 = struct.unpack_from("<4iBB6x", data, at)
            at += 24
            for l in range(levels):
                *edges, voids = struct.unpack_from("<8iB3x", data, at)
                at += 36
                image.levels.append(Level(1 << (log2 - l), tuple(edges[:4]), tuple(edges[4:]), voids))
            self.images.append(image)
        self._read_pixels(zlib.decompress(data[at:-4]))

    def _read_pixels(self, raw):
        at = 0
        for image in self.images:
            for number, level in enumerate(image.levels):
                level.present = np.zeros(level.shape, bool)
                if number == 0:
                    level.present[:] = True
                else:
                    coarser = image.levels[number - 1]
                    for v, u in zip(*np.nonzero(coarser.split)):
                        x = 2 * (u + coarser.rect[0]) - level.rect[0]
                        y = 2 * (v + coarser.rect[2]) - level.rect[2]
                        assert x >= 0 and y >= 0
                        level.present[y:y + 2, x:x + 2] = True
                level.split = np.zeros(level.shape, bool)
                if number + 1 < len(image.levels):
                    count = int(level.present.sum())
                    level.split[level.present] = np.frombuffer(raw, np.uint8, count, at) == 1
                    at += count
        levels = [level for image in self.images for level in image.levels]
        leaves = sum(int((level.present & ~level.split).sum()) for level in levels)
        planes = np.frombuffer(raw, np.uint8, 8 * leaves, at).reshape(2, 4, leaves).astype(int)
        assert at + 8 * leaves == len(raw)
        z = (planes[0] << 8) | planes[1]
        residuals = np.where(z & 1, -(z + 1) // 2, z // 2)
        next_leaf = 0
        for level in levels:
            next_leaf = self._read_leaves(level, residuals, next_leaf)

    def _read_leaves(self, level, residuals, next_leaf):
        is_leaf = level.present & ~level.split
        rows, columns = level.shape
        d = np.zeros((rows, columns, 4), int)
        for v in range(rows):
            for u in range(columns):
                if not is_leaf[v, u]:
                    continue
                left = u > 0 and is_leaf[v, u - 1]
                above = v > 0 and is_leaf[v - 1, u]
                corner = u > 0 and v > 0 and is_leaf[v - 1, u - 1]
                for k in range(4):
                    a = d[v, u - 1, k] if left else 0
                    b = d[v - 1, u, k] if above else 0
                    if left and above:
                        c = d[v - 1, u - 1, k] if corner else a
                        p = min(a, b) if c >= max(a, b) else max(a, b) if c <= min(a, b) else a + b - c
                    else:
                        p = a if left else b
                    d[v, u, k] = (p + residuals[k, next_leaf] + 32768) % 65536 - 32768
                next_leaf += 1
        q = np.stack([d[..., 0] + d[..., 1], d[..., 1], d[..., 2] + d[..., 1], d[..., 3]], -1)
        x = (q.astype(float) ** 2 / 4.0 ** self.bits).astype(F)
        x[..., 3] = F(1) - x[..., 3]
        level.values = np.where(is_leaf[..., None], x, F(0))
        return next_leaf


def contains(rect, u, v):
    return (u >= rect[0]) & (u < rect[1]) & (v >= rect[2]) & (v < rect[3])


class SmoothLevel:
    """"Smoothing": weighted values a and weights h, with three pixels around rect."""

    def __init__(self, level, finer, finer_smooth, basis):
        self.level = level
        self.basis = basis if level.width > 1 else 0
        self.values = self._means(finer, finer_smooth)
        inside = (slice(3, -3), slice(3, -3))
        presence = self._extend(level.present.astype(int), True)
        around = np.ones(level.shape, int)
        rows, columns = level.shape
        for dv in (-1, 0, 1):
            for du in (-1, 0, 1):
                around &= presence[3 + dv:3 + dv + rows, 3 + du:3 + du + columns]
        h = np.where(level.present, np.where(around == 1, F(1), F(0.5)), F(0)).astype(F)
        values = self._stepped(h, presence[inside]) if level.width > 1 else self.values
        self.h = self._extend(h, True)
        self.a = self._extend(h[..., None] * values, level.width > 1)

    def _means(self, finer, finer_smooth):
        level = self.level
        values = level.values.copy()
        for v, u in zip(*np.nonzero(level.split)):
            x, y = 2 * (u + level.rect[0]), 2 * (v + level.rect[2])
            children = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)]
            c = [finer_smooth[cy - finer.rect[2], cx - finer.rect[0]] for cx, cy in children]
            speaks = [contains(finer.crossing, *child) for child in children]
            if all(speaks):
                values[v, u] = F(0.25) * ((c[0] + c[1]) + (c[2] + c[3]))
            else:
                chosen = [c[i] for i in range(4) if speaks[i] or not any(speaks)]
                total = np.zeros(4, F)
                for child in chosen:
                    total = total + child
                values[v, u] = total / F(len(chosen)) if any(speaks) else F(0.25) * total
        return values

    def _extend(self, plane, repeat):
        u0, u1, v0, v1 = [repeat and (self.level.voids >> side) & 1 for side in range(4)]
        rest = [(0, 0)] * (plane.ndim - 2)
        for axis, (before, after) in ((1, (u0, u1)), (0, (v0, v1))):
            for side, wanted in enumerate((before, after)):
                widths = [[0, 0], [0, 0]]
                widths[axis][side] = 3
                plane = np.pad(plane, [tuple(w) for w in widths] + rest, mode="edge" if wanted else "constant")
        return plane

    def _stepped(self, h, present):
        level = self.level
        o = F(1) / F(6) if self.basis else F(0.125)
        n = F(1) - F(2) * o
        t = F(1.5) if self.basis else F(1)
        share = (o, n, o)
        u0, u1, v0, v1 = level.rect
        c = self.values
        out = c.copy()
        for v, u in zip(*np.nonzero(present)):
            x, y = u + u0, v + v0
            crosses = contains(level.crossing, x, y)
            alike = (h[v, u] == 1 and u0 < x < u1 - 1 and v0 < y < v1 - 1 and
                     (not crosses or (contains(level.crossing, x - 1, y - 1) and
                                      contains(level.crossing, x + 1, y + 1))))
            if alike:
                line = [n * c[r, u] + o * (c[r, u - 1] + c[r, u + 1]) for r in (v - 1, v, v + 1)]
                e = c[v, u] - (n * line[1] + o * (line[0] + line[2]))
            else:
                e = np.zeros(4, F)
                for tap in range(9):
                    nx, ny = x + tap % 3 - 1, y + tap // 3 - 1
                    if (contains(level.rect, nx, ny) and present[ny - v0, nx - u0] and
                            (not crosses or contains(level.crossing, nx, ny))):
                        e = e + share[tap % 3] * share[tap // 3] * (c[v, u] - c[ny - v0, nx - u0])
            s = t * e
            most = F(0.5) * c[v, u]
            k = F(1)
            for i in range(4):
                if abs(s[i]) > most[i]:
                    k = min(k, most[i] / abs(s[i]))
            out[v, u] = c[v, u] + k * s
        return out


def smooth(image, basis):
    levels = []
    finer = finer_smooth = None
    for level in reversed(image.levels):
        levels.append(SmoothLevel(level, finer, finer_smooth, basis))
        finer, finer_smooth = level, levels[-1].values
    return levels[::-1]


def mix(a, b, f):
    return a + f * (b - a)


def fixed(t):
    return np.floor(t * 2.0 ** 32 + 0.5).astype(np.int64)


def fraction(x):
    return ((x & 0xFFFFFFFF) >> 8).astype(F) * F(2.0 ** -24)


def row_places(m, j, i, reach, width, origin):
    """Pixels and fractions along a row, for columns within reach: "Orthographic"."""
    places = []
    first = int(np.argmax(reach))
    for axis, rest, start in ((0, m[1] * j + m[2], origin[0]), (3, m[4] * j + m[5], origin[1])):
        x = fixed((rest + m[axis] * first) / width - start) + fixed(np.float64(m[axis]) / width) * (i - first)
        places.append((x >> 32, fraction(x)))
    return places


def sample_smooth(smoothed, x, fx, y, fy):
    """A and h at places counted from the border's first pixel; arrays."""
    a, h = smoothed.a, smoothed.h
    fx4, fy4 = fx[:, None], fy[:, None]
    if not smoothed.basis:
        total = h[y, x] + h[y, x + 1] + h[y + 1, x] + h[y + 1, x + 1]
        value = mix(mix(a[y, x], a[y, x + 1], fx4), mix(a[y + 1, x], a[y + 1, x + 1], fx4), fy4)
        weight = mix(mix(h[y, x], h[y, x + 1], fx), mix(h[y + 1, x], h[y + 1, x + 1], fx), fy)
        return value, np.where(total == 4, F(1), weight), total > 0

    def spline(f):
        before = F(0.5) * (F(1) - f) * (F(1) - f)
        after = F(0.5) * f * f
        return before, F(1) - before - after, after

    def along(p, weights, cross):
        def line(r):
            return (weights[0] * p[r, x - 1] + weights[1] * p[r, x]) + weights[2] * p[r, x + 1]
        return (cross[0] * line(y - 1) + cross[1] * line(y)) + cross[2] * line(y + 1)

    total = sum(h[y + dv, x + du] for dv in (-1, 0, 1) for du in (-1, 0, 1))
    value = along(a, spline(fx4), spline(fy4))
    weight = along(h, spline(fx), spline(fy))
    return value, np.where(total == 9, F(1), weight), total > 0


def within(m, j, i, rect, width, margin):
    """Which columns lie in rect or at most `margin` voxels beside it."""
    u = (m[1] * j + m[2]) + m[0] * i
    v = (m[4] * j + m[5]) + m[3] * i
    return ((u >= width * rect[0] - margin) & (u <= width * rect[1] + margin) &
            (v >= width * rect[2] - margin) & (v <= width * rect[3] + margin))


def cover_of(sheet, u, v):
    du = np.minimum(u - sheet[0], sheet[1] - u)
    dv = np.minimum(v - sheet[2], sheet[3] - v)
    return (np.clip(du + 0.5, 0, 1) * np.clip(dv + 0.5, 0, 1)).astype(F), np.minimum(du, dv)


def expand_orthographic(frame):
    picture = np.zeros((frame.height, frame.width, 4), F)
    image = frame.images[0]
    m = frame.geometry
    levels = smooth(image, frame.basis) if frame.smoothing else None
    i = np.arange(frame.width)
    for j in range(frame.height):
        drawn = within(m, j, i, image.sheet, 1, 0.5)
        if not drawn.any():
            continue
        if levels is None:
            reach = drawn & within(m, j, i, image.levels[0].rect, image.levels[0].width, 0.5)
            if not reach.any():
                continue
            places = row_places(m, j, i, reach, 1, (image.sheet[0] + 0.5, image.sheet[2] + 0.5))
            (x, fx), (y, fy) = places
            for column in np.nonzero(reach)[0]:
                t = [leaf(image, x[column] + image.sheet[0] + du, y[column] + image.sheet[2] + dv)
                     for dv in (0, 1) for du in (0, 1)]
                picture[j, column] = mix(mix(t[0], t[1], fx[column]), mix(t[2], t[3], fx[column]), fy[column])
            continue
        u = (m[1] * j + m[2]) + m[0] * i
        v = (m[4] * j + m[5]) + m[3] * i
        cover, depth = cover_of(image.sheet, u, v)
        cover = np.where(depth >= 0.5, F(1), cover)
        picture[j] = draw_row(levels, drawn, cover, lambda s: row_reach(m, j, i, s, drawn))
    return picture


def row_reach(m, j, i, smoothed, drawn):
    level = smoothed.level
    margin = level.width if smoothed.basis else level.width / 2
    reach = drawn & within(m, j, i, level.rect, level.width, margin)
    if not reach.any():
        return None
    to_tap = (0.0 if smoothed.basis else 0.5) - 3
    (x, fx), (y, fy) = row_places(m, j, i, reach, level.width, (level.rect[0] + to_tap, level.rect[2] + to_tap))
    return reach, x, fx, y, fy


def draw_row(levels, drawn, cover, places_of):
    value = np.zeros((len(drawn), 4), F)
    left = np.where(drawn, F(1), F(0))
    for smoothed in reversed(levels):
        places = places_of(smoothed)
        if places is None:
            continue
        reach, x, fx, y, fy = places
        at = np.nonzero(reach & (left > F(1e-6)))[0]
        a, h, has = sample_smooth(smoothed, x[at], fx[at], y[at], fy[at])
        at, a, h = at[has], a[has], h[has]
        share = left[at] if smoothed.level.width == 1 else left[at] * cover[at]
        value[at] = value[at] + share[:, None] * a
        left[at] = left[at] * (F(1) - h)
    return value


def leaf(image, u, v):
    if not contains(image.sheet, u, v):
        return np.zeros(4, F)
    for level in image.levels:
        x, y = u // level.width, v // level.width
        if not contains(level.rect, x, y):
            break
        x, y = x - level.rect[0], y - level.rect[2]
        if not level.split[y, x]:
            return level.values[y, x]
    return np.zeros(4, F)


def expand_perspective(frame):
    eye, first, column, row = (np.array(frame.geometry[3 * k:3 * k + 3]) for k in range(4))
    picture = np.zeros((frame.height * frame.width, 4), F)
    j, i = np.divmod(np.arange(frame.height * frame.width), frame.width)
    rays = (first + i[:, None] * column) + j[:, None] * row
    axis = np.argmax(np.abs(rays), 1)
    faces = 2 * axis + (np.take_along_axis(rays, axis[:, None], 1)[:, 0] < 0)
    for image in frame.images:
        k = image.face // 2
        ku, kv = [other for other in range(3) if other != k]
        at = np.nonzero(faces == image.face)[0]
        if len(at) == 0:
            continue
        s = (image.z0 - eye[k]) / rays[at, k]
        u, v = eye[ku] + s * rays[at, ku], eye[kv] + s * rays[at, kv]
        steps = np.array(image.steps).reshape(3, 3)
        way = (steps[2] + ((u - eye[ku]) / (image.z0 - eye[k]))[:, None] * steps[0] +
               ((v - eye[kv]) / (image.z0 - eye[k]))[:, None] * steps[1])
        ratio = (np.linalg.norm(way, axis=1) / image.p0).astype(F)
        picture[at] = lengthened(look_up(frame, image, u, v), ratio)
    return picture.reshape(frame.height, frame.width, 4)


def look_up(frame, image, u, v):
    if not frame.smoothing:
        x, y = np.floor(u - 0.5), np.floor(v - 0.5)
        fx, fy = (u - 0.5 - x).astype(F), (v - 0.5 - y).astype(F)
        out = np.zeros((len(u), 4), F)
        for p in range(len(u)):
            t = [leaf(image, int(x[p]) + du, int(y[p]) + dv) for dv in (0, 1) for du in (0, 1)]
            out[p] = mix(mix(t[0], t[1], fx[p]), mix(t[2], t[3], fx[p]), fy[p])
        return out
    cover, _ = cover_of(image.sheet, u, v)

    def places_of(smoothed):
        level = smoothed.level
        origin = 0.0 if smoothed.basis else 0.5
        x, y = u / level.width - origin, v / level.width - origin
        fx, fy = np.floor(x), np.floor(y)
        u0, u1, v0, v1 = level.rect
        reach = (fx >= u0 - 1) & (fx <= u1) & (fy >= v0 - 1) & (fy <= v1)
        ix = np.where(reach, fx, u0).astype(int) - u0 + 3
        iy = np.where(reach, fy, v0).astype(int) - v0 + 3
        return reach, ix, (x - fx).astype(F), iy, (y - fy).astype(F)

    return draw_row(smooth(image, frame.basis), cover > 0, cover, places_of)


def lengthened(values, ratio):
    alpha = np.minimum(values[:, 3], F(1))
    seen = alpha > 0
    cover = F(1) - np.exp(ratio * np.log(np.maximum(F(1) - alpha, F(1e-7))))
    scale = np.where(seen, cover / np.where(seen, alpha, F(1)), F(0))
    out = scale[:, None] * values
    out[:, 3] = np.where(seen, cover, values[:, 3])
    return out


def draw_marker(picture, marker):
    height, width, _ = picture.shape
    r = max(3, 0.008 * height)
    rim = max(1, r / 4)
    y, x = np.mgrid[0:height, 0:width]
    distance = np.hypot(x + 0.5 - marker[0], y + 0.5 - marker[1])
    outer = np.clip(r + rim - distance + 0.5, 0, 1).astype(F)
    inner = np.clip(r - distance + 0.5, 0, 1).astype(F)
    red = outer * (inner + (F(1) - inner) * F(0.05))
    picture *= (F(1) - outer)[..., None]
    picture[..., 0] += red
    picture[..., 3] += outer


def srgb_bytes(picture, background):
    """R, G, B, A bytes."""
    rest = F(1) - picture[..., 3:]
    x = np.clip((picture[..., :3] + rest * background).astype(float), 0, 1)
    srgb = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    alpha = np.clip(picture[..., 3:].astype(float), 0, 1)
    return np.floor(255 * np.concatenate([srgb, alpha], -1) + 0.5).astype(np.uint8)


def expand(data):
    frame = Frame(data)
    picture = (expand_perspective if frame.perspective else expand_orthographic)(frame)
    if frame.marker:
        draw_marker(picture, frame.marker)
    return srgb_bytes(picture, frame.background)
