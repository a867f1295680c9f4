// Projection and its inverse, a vector of points at a time; points that a few Newton steps do not solve are searched
// one by one.
#include "lens.hpp"

#include <algorithm>
#include <limits>
#include <type_traits>

#include "lens_maps.hpp"

namespace vbaa::lens {
namespace {

constexpr int STEPS = 5;
constexpr double LEAST_DEPTH = 1e-12;      // Z of a unit vector from which on X/Z counts as a number
constexpr double GRAZING = 9.99999833e-4;  // sine of 1e-3 rad: rays at a smaller angle to the plane are not intersected
constexpr double NEAREST_M = 1e-9;         // a plane closer to the camera than this passes through it

template <class T>
using Mask = decltype(T{} < T{});

// work(begin, some, columns) for a vector of points (N, K) at a time; the last ones are repeated to fill it.
template <class T, int K, class Work>
void in_vectors(View<const Number<T>, 2> points, Work work) {
    constexpr int COUNT = Kind<T>::count;
    std::array<T, K> at;
    for (int begin = 0; begin < points.shape[0]; begin += COUNT) {
        const int some = std::min(COUNT, points.shape[0] - begin);
        const Number<T>* from = points.data + static_cast<std::size_t>(begin) * K;
        if constexpr (K == 2 && std::is_same_v<T, Lanes>) {
            if (some == COUNT) {
                unpair(from, at[0], at[1]);
                work(begin, some, at);
                continue;
            }
        }
        for (int lane = 0; lane < COUNT; ++lane)
            for (int k = 0; k < K; ++k) at[k][lane] = from[std::min(lane, some - 1) * K + k];
        work(begin, some, at);
    }
}

// Writes values into one column of `some` rows from `begin` on.
template <class T, class S>
void put(S* rows, int width, int column, int begin, int some, T values) {
    S* to = rows + static_cast<std::size_t>(begin) * width + column;
    for (int lane = 0; lane < some; ++lane) to[static_cast<std::size_t>(lane) * width] = values[lane];
}

void put(const Column& to, int begin, int some, const Lanes& values) {
    if (to.apart == 1 && some == LANES) {
        store(to.first + begin, values);
    } else {
        put(to.first, to.apart, 0, begin, some, values);
    }
}

template <class T>
T known(Mask<T> valid, T values) {
    return choose(valid, values, T(Number<T>(NOT_KNOWN)));
}

template <class T>
void put_valid(bool* to, int begin, int some, Mask<T> valid) {
    if (some == Kind<T>::count) {
        valid.put(to + begin);
        return;
    }
    for (int lane = 0; lane < some; ++lane) to[begin + lane] = valid[lane];
}

// A 2 × 2 matrix.
template <class T>
struct Two {
    T xx, xy, yx, yy;

    Two operator*(const Two& by) const {
        return {xx * by.xx + xy * by.yx, xx * by.xy + xy * by.yy, yx * by.xx + yy * by.yx, yx * by.xy + yy * by.yy};
    }
};

template <class T>
Two<T> inverse_of(const Mapped<T>& map) {
    const T scale = Number<T>(1) / map.determinant();
    return {map.yy * scale, -map.xy * scale, -map.yx * scale, map.xx * scale};
}

template <class T>
Two<T> normalized_by_chart(const Layout<T>& ray, T x, T y) {
    const T inverse = Number<T>(1) / ray.height, tangent = ray.ratio * inverse;
    const T growth = ray.bend * inverse + tangent * tangent, shear = growth * x * y;
    return {tangent + growth * x * x, shear, shear, tangent + growth * y * y};
}

// Back-projected pixels: their chart points, the forward map there, and which of them are valid.
template <class T>
struct Undone {
    T x, y;
    Sensed<T> at;
    Mask<T> valid;
};

// Whether a rim encloses points; `within` says which are inside its smallest radius.
template <class T>
Mask<T> enclosed(const Rim& rim, Mask<T> within, T x, T y) {
    for (int lane = 0; lane < Kind<T>::count; ++lane)
        if (!within[lane] && rim.encloses(x[lane], y[lane])) within[lane] = true;
    return within;
}

// Ideal radius over the distorted one, by the table.
template <class T>
T first_ratio(const RadialTable& table, T distorted_radius) {
    using S = Number<T>;
    const T limit = T{} + S(table.distorted_limit);
    const T within = choose(distorted_radius < limit, T(distorted_radius), T(limit));
    const T place = S(table.nodes_per_unit) * (within / (S(1) + within));
    T node, step;
    int index[Kind<T>::count];
    const S last = S(table.nodes.size() - 1);
    // at the table's end, or beyond it, the last node has no step
    const T before = truncated(choose(place < T{} + last, place, T{} + last), index);
    for (int lane = 0; lane < Kind<T>::count; ++lane) {
        node[lane] = S(table.nodes[index[lane]]), step[lane] = S(table.steps[index[lane]]);
    }
    return (node + (place - before) * step) / (within + S(1e-15));
}

template <class T>
[[gnu::noinline]] Undone<T> undone(const Lens& lens, T u, T v) {
    using S = Number<T>;
    constexpr bool single = sizeof(S) == sizeof(float);
    constexpr S relative = single ? S(4e-7) : S(5e-14), least = single ? S(1e-30) : S(1e-300);
    T x = (u - S(lens.cx)) * S(1.0 / lens.fx), y = (v - S(lens.cy)) * S(1.0 / lens.fy), depth = T{} + S(1);
    if (lens.tilted) untilt(lens, x, y, depth);
    const T size = sqrt(x * x + y * y);
    const bool full = lens.path == Path::full;
    // points that no ray reaches need no search; a rim's directions are computed only if there is one
    const S limit = full ? std::numeric_limits<S>::max() : S(lens.distorted_limit);
    const Mask<T> reachable = (size < T{} + limit) & (depth > T{});
    x = choose(reachable, x, T{}), y = choose(reachable, y, T{});
    Undone<T> found;
    found.x = x, found.y = y, found.valid = reachable;
    if (lens.path == Path::none) {
        found.at = on_sensor(lens, x, y);
        found.valid &= found.at.depth > T{} + S(LEAST_DEPTH);  // not a tilted sensor's horizon
        return found;
    }
    const T distance = choose(reachable, size, T{}), ratio = first_ratio(lens.table, distance);
    const T allowed = relative * distance + least;
    T beyond;
    found.x = x * ratio, found.y = y * ratio;
    Mapped<T> bent;
    for (int step = 0;; ++step) {
        bent = distorted(lens, found.x, found.y);
        const T off_x = x - bent.x, off_y = y - bent.y, size_x = size_of(off_x), size_y = size_of(off_y);
        beyond = choose(size_x > size_y, size_x, size_y) - allowed;
        if (step == STEPS - 1 || !(beyond > T{}).any()) break;
        const T scale = S(1) / bent.determinant();
        found.x = choose(beyond > T{}, found.x + (bent.yy * off_x - bent.xy * off_y) * scale, found.x);
        found.y = choose(beyond > T{}, found.y + (bent.xx * off_y - bent.yx * off_x) * scale, found.y);
    }
    // in single precision one more rounding is allowed, a fraction of 1e-3 px
    Mask<T> good = (single ? beyond <= S(1.5) * allowed : beyond <= T{}) & bent.definite();
    const T square = found.x * found.x + found.y * found.y;
    const Mask<T> within = square < T{} + S(lens.ideal_limit * lens.ideal_limit);
    good = good & (full ? enclosed<T>(lens.ideal, within, found.x, found.y) : within);
    found.valid = reachable & good;
    if (const Mask<T> rest = reachable & ~good; rest.any()) {
        for (int lane = 0; lane < Kind<T>::count; ++lane) {
            double ideal_x = found.x[lane], ideal_y = found.y[lane];
            if (!rest[lane] || (full && !lens.reach.encloses(x[lane], y[lane]))) continue;
            if (!searched(lens, x[lane], y[lane], ideal_x, ideal_y)) continue;
            found.x[lane] = S(ideal_x), found.y[lane] = S(ideal_y), found.valid[lane] = true;
        }
        bent = distorted(lens, found.x, found.y);
    }
    found.at = on_sensor<T>(lens, bent);
    found.valid &= found.at.depth > T{} + S(LEAST_DEPTH);  // not a tilted sensor's horizon
    return found;
}

// −d(chart)/d(fx, fy, cx, cy, *distortion) of fixed pixels, from `from` = d(anything)/d(sensor) (2 or 3 rows): put(row,
// column, values).
template <class T, int ROWS, class Put>
void by_parameters(const Lens& lens, T x, T y, const Sensed<T>& at, const T (&from)[ROWS][2], Put put) {
    const T scale_x = T{} - 1.0 / lens.fx, scale_y = T{} - 1.0 / lens.fy;
    for (int row = 0; row < ROWS; ++row) {
        const T by_u = from[row][0] * scale_x, by_v = from[row][1] * scale_y;
        put(row, 0, by_u * at.x), put(row, 1, by_v * at.y), put(row, 2, by_u), put(row, 3, by_v);
    }
    by_coefficients(lens, x, y, at, [&](int i, T dx, T dy) {
        for (int row = 0; row < ROWS; ++row) put(row, 4 + i, -(from[row][0] * dx + from[row][1] * dy));
    });
}

// d(unit ray)/d(sensor), (3, 2).
template <class T>
void ray_by_sensor(const Layout<T>& ray, const Undone<T>& p, T (&by)[3][2]) {
    const Two<T> back = inverse_of<T>(p.at);
    const T shear = ray.xy(p.x, p.y);
    const T rows[3][2] = {{ray.xx(p.x), shear}, {shear, ray.xx(p.y)}, {-p.x * ray.drop, -p.y * ray.drop}};
    for (int row = 0; row < 3; ++row) {
        by[row][0] = rows[row][0] * back.xx + rows[row][1] * back.yx;
        by[row][1] = rows[row][0] * back.xy + rows[row][1] * back.yy;
    }
}

// A plane as the camera sees it: all in the camera's frame.
struct SeenPlane {
    int rows;
    double normal[3], axes[3][3], origin[3], height_m;

    SeenPlane(const Plane& plane) : rows(plane.axes.shape[0]), normal(), axes(), origin(), height_m(plane.offset_m) {
        for (int k = 0; k < 3; ++k) {
            height_m -= plane.normal[k] * plane.translation_m[k];
            for (int j = 0; j < 3; ++j) {
                normal[j] += plane.normal[k] * plane.rotation(k, j);
                for (int row = 0; row < rows; ++row) axes[row][j] += plane.axes(row, k) * plane.rotation(k, j);
            }
            for (int row = 0; row < rows; ++row) origin[row] += plane.axes(row, k) * plane.translation_m[k];
        }
    }

    // Distances along directions, of squared length `size2`, at which they meet the plane, and which do.
    template <class T>
    T along(const T (&direction)[3], T size2, Mask<T>& valid) const {
        using S = Number<T>;
        const T slant = dot(normal, direction);
        const T ahead = height_m > 0.0 ? slant : -slant;
        valid &= (slant * slant > S(GRAZING * GRAZING) * size2) & (ahead > T{});
        if (!(std::abs(height_m) > NEAREST_M)) valid = Mask<T>{};
        return S(height_m) / slant;
    }

    template <class T>
    static T dot(const double (&row)[3], const T (&direction)[3]) {
        using S = Number<T>;
        return S(row[0]) * direction[0] + S(row[1]) * direction[1] + S(row[2]) * direction[2];
    }
};

template <class T>
void plane_of(const Lens& lens, const Plane& seen, View<const Number<T>, 2> pixels, View<Number<T>, 2> points,
              bool* valid) {
    using S = Number<T>;
    const SeenPlane plane(seen);
    in_vectors<T, 2>(pixels, [&](int begin, int some, const std::array<T, 2>& pixel) {
        Undone<T> p = undone(lens, pixel[0], pixel[1]);
        T direction[3] = {p.x, p.y, T{} + S(1)}, size2 = S(1) + p.x * p.x + p.y * p.y;
        if (lens.fisheye) {
            const Layout<T> ray = ray_of_chart(true, p.x, p.y);
            direction[0] *= ray.ratio, direction[1] *= ray.ratio, direction[2] = ray.height, size2 = T{} + S(1);
        }
        const T along = plane.along(direction, size2, p.valid);
        for (int row = 0; row < plane.rows; ++row) {
            const T place = S(plane.origin[row]) + along * plane.dot(plane.axes[row], direction);
            put(points.data, plane.rows, row, begin, some, known<T>(p.valid, place));
        }
        put_valid<T>(valid, begin, some, p.valid);
    });
}

// Calls work(begin, some, place) for a vector of pixels at a time, with the derivatives of their coordinates on a plane
// by the sensor's.
template <class Work>
void sliding(const Lens& lens, const Plane& seen, ConstMatrix pixels, Work work) {
    const SeenPlane plane(seen);
    in_vectors<Lanes, 2>(pixels, [&](int begin, int some, const std::array<Lanes, 2>& pixel) {
        Undone<Lanes> p = undone(lens, pixel[0], pixel[1]);
        const Layout<Lanes> ray = ray_of_chart(lens.fisheye, p.x, p.y);
        const Lanes direction[3] = {p.x * ray.ratio, p.y * ray.ratio, ray.height};
        const Lanes along = plane.along(direction, spread(1.0), p.valid), slant = plane.dot(plane.normal, direction);
        Lanes turned[3][2], by_sensor[3][2] = {}, shift[3];
        ray_by_sensor(ray, p, turned);
        for (int row = 0; row < plane.rows; ++row) {
            shift[row] = plane.dot(plane.axes[row], direction) / slant;
            for (int k = 0; k < 3; ++k)
                for (int axis = 0; axis < 2; ++axis)
                    by_sensor[row][axis] +=
                        along * (plane.axes[row][k] - shift[row] * plane.normal[k]) * turned[k][axis];
        }
        work(begin, some, p, direction, along, shift, by_sensor);
    });
}

}  // namespace

void project(const Lens& lens, ConstMatrix points, Matrix pixels, bool* valid, Cube by_point, Cube by_lens) {
    in_vectors<Lanes, 3>(points, [&](int begin, int some, const std::array<Lanes, 3>& point) {
        const Lanes across2 = point[0] * point[0] + point[1] * point[1], zero = {};
        Mask<Lanes> ahead = point[2] > zero;
        if (lens.fisheye) ahead |= across2 > zero;
        ahead &= (point[0] - point[0] == zero) & (point[1] - point[1] == zero) & (point[2] - point[2] == zero);
        const Lanes from_x = choose(ahead, point[0], zero), from_y = choose(ahead, point[1], zero);
        const Layout<Lanes> to = chart_of_point(lens.fisheye, from_x, from_y, choose(ahead, point[2], spread(1.0)));
        const Lanes x = from_x * to.ratio, y = from_y * to.ratio;
        const Sensed<Lanes> at = on_sensor(lens, x, y);
        const Mask<Lanes> near = x * x + y * y < spread(lens.ideal_limit * lens.ideal_limit);
        Mask<Lanes> seen = near & ahead & (at.depth > zero);
        if (lens.path == Path::full)
            seen = enclosed<Lanes>(lens.ideal, near, x, y) & (near | at.bent.definite()) & ahead & (at.depth > zero);
        put(pixels.data, 2, 0, begin, some, known<Lanes>(seen, at.x * lens.fx + lens.cx));
        put(pixels.data, 2, 1, begin, some, known<Lanes>(seen, at.y * lens.fy + lens.cy));
        put_valid<Lanes>(valid, begin, some, seen);
        if (by_point.size()) {
            const Lanes shear = to.xy(from_x, from_y), drop_x = -from_x * to.drop, drop_y = -from_y * to.drop;
            const Lanes columns[3][2] = {{to.xx(from_x), shear}, {shear, to.xx(from_y)}, {drop_x, drop_y}};
            for (int k = 0; k < 3; ++k) {
                const Lanes u = lens.fx * (at.xx * columns[k][0] + at.xy * columns[k][1]);
                const Lanes v = lens.fy * (at.yx * columns[k][0] + at.yy * columns[k][1]);
                put(by_point.data, 6, k, begin, some, choose(seen, u, zero));
                put(by_point.data, 6, 3 + k, begin, some, choose(seen, v, zero));
            }
        }
        if (!by_lens.size()) return;
        const int width = lens.parameters();
        const auto place = [&](int i, Lanes u, Lanes v) {
            put(by_lens.data, 2 * width, i, begin, some, choose(seen, u, zero));
            put(by_lens.data, 2 * width, width + i, begin, some, choose(seen, v, zero));
        };
        place(0, at.x, zero), place(1, zero, at.y), place(2, spread(1.0), zero), place(3, zero, spread(1.0));
        by_coefficients(lens, x, y, at, [&](int i, Lanes dx, Lanes dy) { place(4 + i, lens.fx * dx, lens.fy * dy); });
    });
}

void chart_of_pixels(const Lens& lens, ConstMatrix pixels, Matrix points, bool* valid) {
    in_vectors<Lanes, 2>(pixels, [&](int begin, int some, const std::array<Lanes, 2>& pixel) {
        const Undone<Lanes> p = undone(lens, pixel[0], pixel[1]);
        put(points.data, 2, 0, begin, some, known<Lanes>(p.valid, p.x));
        put(points.data, 2, 1, begin, some, known<Lanes>(p.valid, p.y));
        put_valid<Lanes>(valid, begin, some, p.valid);
    });
}

void rays_of_pixels(const Lens& lens, ConstMatrix pixels, Matrix rays, bool* valid) {
    in_vectors<Lanes, 2>(pixels, [&](int begin, int some, const std::array<Lanes, 2>& pixel) {
        const Undone<Lanes> p = undone(lens, pixel[0], pixel[1]);
        const Layout<Lanes> ray = ray_of_chart(lens.fisheye, p.x, p.y);
        put(rays.data, 3, 0, begin, some, known<Lanes>(p.valid, p.x * ray.ratio));
        put(rays.data, 3, 1, begin, some, known<Lanes>(p.valid, p.y * ray.ratio));
        put(rays.data, 3, 2, begin, some, known<Lanes>(p.valid, ray.height));
        put_valid<Lanes>(valid, begin, some, p.valid);
    });
}

void rays_with_slopes(const Lens& lens, ConstMatrix pixels, Matrix rays, Cube by_pixel, Cube by_lens, bool* valid) {
    const int width = lens.parameters();
    rays_of_pixels(lens, pixels, rays, valid);
    in_vectors<Lanes, 2>(pixels, [&](int begin, int some, const std::array<Lanes, 2>& pixel) {
        const Undone<Lanes> p = undone(lens, pixel[0], pixel[1]);
        Lanes by[3][2];
        ray_by_sensor(ray_of_chart(lens.fisheye, p.x, p.y), p, by);
        for (int row = 0; row < 3; ++row) {
            put(by_pixel.data, 6, 2 * row, begin, some, known<Lanes>(p.valid, by[row][0] / lens.fx));
            put(by_pixel.data, 6, 2 * row + 1, begin, some, known<Lanes>(p.valid, by[row][1] / lens.fy));
        }
        by_parameters(lens, p.x, p.y, p.at, by, [&](int row, int column, Lanes values) {
            put(by_lens.data, 3 * width, row * width + column, begin, some, known<Lanes>(p.valid, values));
        });
    });
}

void normalized_of_pixels(const Lens& lens, ConstMatrix pixels, const Normalized& to, bool* valid) {
    in_vectors<Lanes, 2>(pixels, [&](int begin, int some, const std::array<Lanes, 2>& pixel) {
        Undone<Lanes> p = undone(lens, pixel[0], pixel[1]);
        Two<Lanes> by = inverse_of<Lanes>(p.at);
        Lanes x = p.x, y = p.y;
        if (lens.fisheye) {
            const Layout<Lanes> ray = ray_of_chart(true, p.x, p.y);
            p.valid &= ray.height > spread(LEAST_DEPTH);
            by = normalized_by_chart(ray, p.x, p.y) * by;
            x *= ray.ratio / ray.height, y *= ray.ratio / ray.height;
        }
        put(to.x, begin, some, known<Lanes>(p.valid, x));
        put(to.y, begin, some, known<Lanes>(p.valid, y));
        put_valid<Lanes>(valid, begin, some, p.valid);
        const double by_u = 1.0 / lens.fx, by_v = 1.0 / lens.fy;
        const Lanes slopes[4] = {by.xx * by_u, by.xy * by_v, by.yx * by_u, by.yy * by_v};
        for (int k = 0; to.slopes[0].first && k < 4; ++k)
            put(to.slopes[k], begin, some, known<Lanes>(p.valid, slopes[k]));
    });
}

void normalized_by_lens(const Lens& lens, double (&seen)[6][LANES], Cube columns) {
    Lanes x = load(seen[0]), y = load(seen[1]);
    Two<Lanes> by_chart = {spread(1.0), {}, {}, spread(1.0)};
    if (lens.fisheye) {
        const Layout<Lanes> to = chart_of_point(true, x, y, spread(1.0));
        x *= to.ratio, y *= to.ratio;
        by_chart = normalized_by_chart(ray_of_chart(true, x, y), x, y);
    }
    const Sensed<Lanes> at = on_sensor(lens, x, y);
    Mask<Lanes> there = at.depth > Lanes{};
    for (int lane = 0; lane < LANES; ++lane) there[lane] = there[lane] && sees(lens, x[lane], y[lane]);
    store(seen[2], choose(there, spread(1.0), Lanes{}));
    const Two<Lanes> by = by_chart * inverse_of<Lanes>(at);
    const Lanes from[2][2] = {{by.xx, by.xy}, {by.yx, by.yy}};
    by_parameters(lens, x, y, at, from, [&](int row, int column, Lanes values) {
        store(&columns(row, column, 0), choose(there, values, Lanes{}));
    });
}

void normalized_by_lens(const Lens& lens, ConstMatrix points, Cube slopes) {
    const int width = lens.parameters();
    Array<double, 3> columns(2, width, LANES);
    in_vectors<Lanes, 2>(points, [&](int begin, int some, const std::array<Lanes, 2>& point) {
        double seen[6][LANES];
        store(seen[0], point[0]), store(seen[1], point[1]);
        normalized_by_lens(lens, seen, columns);
        const Mask<Lanes> there = load(seen[2]) > Lanes{};
        for (int i = 0; i < 2 * width; ++i)
            put(slopes.data, 2 * width, i, begin, some, known<Lanes>(there, load(columns.begin() + i * LANES)));
    });
}

void plane_of_pixels(const Lens& lens, const Plane& plane, ConstMatrix pixels, Matrix points, bool* valid) {
    plane_of<Lanes>(lens, plane, pixels, points, valid);
}

void plane_of_pixels(const Lens& lens, const Plane& plane, View<const float, 2> pixels, View<float, 2> points,
                     bool* valid) {
    const auto& c = lens.coefficients;
    if (!lens.rational || std::min({c[5], c[6], c[7]}) >= 0.0) {
        plane_of<FloatLanes>(lens, plane, pixels, points, valid);
        return;
    }
    // a denominator with cancelling terms has too few digits
    const Array<double, 2> wide(pixels);
    Array<double, 2> found(points.shape[0], points.shape[1]);
    plane_of<Lanes>(lens, plane, wide, found, valid);
    for (int i = 0; i < found.size(); ++i) points.data[i] = static_cast<float>(found[i]);
}

void plane_by_pixel(const Lens& lens, const Plane& plane, ConstMatrix pixels, Cube slopes) {
    const int rows = plane.axes.shape[0];
    sliding(lens, plane, pixels, [&](int begin, int some, const auto& p, auto&, Lanes, auto&, const auto& by) {
        for (int row = 0; row < rows; ++row) {
            put(slopes.data, 2 * rows, 2 * row, begin, some, known<Lanes>(p.valid, by[row][0] / lens.fx));
            put(slopes.data, 2 * rows, 2 * row + 1, begin, some, known<Lanes>(p.valid, by[row][1] / lens.fy));
        }
    });
}

void plane_by_calibration(const Lens& lens, const Plane& plane, ConstMatrix pixels, Cube slopes) {
    const int rows = plane.axes.shape[0], width = lens.parameters() + 6;
    const auto& pose = plane.rotation;
    sliding(
        lens, plane, pixels,
        [&](int begin, int some, const auto& p, const auto& direction, Lanes along, const auto& shift, const auto& by) {
            const auto place = [&](int row, int column, Lanes values) {
                if (row < rows)
                    put(slopes.data, rows * width, row * width + column, begin, some, known<Lanes>(p.valid, values));
            };
            by_parameters(lens, p.x, p.y, p.at, by, place);
            Lanes ray[3];
            for (int k = 0; k < 3; ++k)
                ray[k] = pose(k, 0) * direction[0] + pose(k, 1) * direction[1] + pose(k, 2) * direction[2];
            for (int row = 0; row < rows; ++row)
                for (int k = 0; k < 3; ++k) {  // the point by the origin, and the direction turned: along ray × that
                    const int next = (k + 1) % 3, last = (k + 2) % 3;
                    const auto by_origin = [&](int j) { return plane.axes(row, j) - shift[row] * plane.normal[j]; };
                    place(row, width - 3 + k, by_origin(k));
                    place(row, width - 6 + k, along * (ray[next] * by_origin(last) - ray[last] * by_origin(next)));
                }
        });
}

}  // namespace vbaa::lens
