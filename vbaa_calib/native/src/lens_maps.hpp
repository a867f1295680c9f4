// The maps of a lens model with their derivatives, each written once: for numbers (double) and vectors of numbers.
#pragma once

#include <cmath>

#include "lens.hpp"

namespace vbaa::lens {

template <class T>
struct Kind {
    using Number = double;
    static constexpr int count = sizeof(T) / sizeof(double);
};
template <>
struct Kind<FloatLanes> {
    using Number = float;
    static constexpr int count = sizeof(FloatLanes) / sizeof(float);
};
template <class T>
using Number = typename Kind<T>::Number;

using std::atan2, std::cos, std::sin, std::sqrt;
using vbaa::cos, vbaa::sin, vbaa::sqrt;

// A function of one number on each of a vector.
template <class T, class Function>
T each(T values, Function function) {
    for (int lane = 0; lane < Kind<T>::count; ++lane) values[lane] = function(values[lane]);
    return values;
}
inline FloatLanes sqrt(FloatLanes v) {
    return each(v, [](float one) { return std::sqrt(one); });
}
inline FloatLanes sin(FloatLanes v) {
    return each(v, [](float one) { return std::sin(one); });
}
inline FloatLanes cos(FloatLanes v) {
    return each(v, [](float one) { return std::cos(one); });
}
inline Lanes atan2(Lanes y, Lanes x) {
    for (int lane = 0; lane < LANES; ++lane) y[lane] = std::atan2(y[lane], x[lane]);
    return y;
}
template <class T>
T size_of(T values) {
    return choose(values < T{}, -values, values);
}

constexpr double SMALL_SQUARE = 1e-6;  // of an angle or its tangent: below, series

// How a vector (X, Y, Z) is laid out as ratio·(X, Y), or a chart point (x, y) taken to (ratio·(x, y), height):
// derivatives [[ratio + X² bend, X Y bend, −X drop], [X Y bend, ratio + Y² bend, −Y drop]], for a ray transposed.
template <class T>
struct Layout {
    T ratio, bend, drop, height;

    T xx(T x) const { return ratio + x * x * bend; }
    T xy(T x, T y) const { return x * y * bend; }
};

// Layout of a point (X, Y, Z) on the chart.
template <class T>
Layout<T> chart_of_point(bool fisheye, T x, T y, T z) {
    using S = Number<T>;
    const T inverse = S(1) / z, across2 = x * x + y * y, tan2 = across2 * inverse * inverse;
    if (!fisheye) return {inverse, T{}, inverse * inverse, T{}};
    const auto near = (tan2 < T{} + S(SMALL_SQUARE)) & (z > T{});
    const T across = sqrt(across2), drop = S(1) / (across2 + z * z);
    const T ratio =
        choose(near, T(inverse * (S(1) - tan2 * (S(1.0 / 3.0) - tan2 * S(0.2)))), T(atan2(across, z) / across));
    const T series = inverse * inverse * inverse * (S(0.8) * tan2 - S(2.0 / 3.0));
    return {ratio, choose(near, T(series), T((z * drop - ratio) / across2)), drop, T{}};
}

// Layout of a chart point as a unit ray.
template <class T>
Layout<T> ray_of_chart(bool fisheye, T x, T y) {
    using S = Number<T>;
    const T square = x * x + y * y;
    if (!fisheye) {
        const T height = S(1) / sqrt(S(1) + square), cube = height * height * height;
        return {height, -cube, cube, height};
    }
    const auto near = square < T{} + S(SMALL_SQUARE);
    const T angle = sqrt(choose(near, T(S(1)), square));
    const T height = choose(near, T(S(1) - square * (S(0.5) - square * S(1.0 / 24.0))), T(cos(angle)));
    const T ratio = choose(near, T(S(1) - square * (S(1.0 / 6.0) - square * S(1.0 / 120.0))), T(sin(angle) / angle));
    const T bend = choose(near, T(square * S(1.0 / 30.0) - S(1.0 / 3.0)), T((height - ratio) / (angle * angle)));
    return {ratio, bend, ratio, height};
}

// Radial gain g at a squared radius s, dg/ds, and one over the gain's denominator.
template <class T>
struct Gain {
    T value, by_s, inverse;
};

template <class T>
Gain<T> radial(const Model& model, T s) {
    using S = Number<T>;
    const auto c = [&](int i) { return S(model.coefficients[i]); };
    if (model.fisheye) {
        const T by_s = c(0) + s * (S(2) * c(1) + s * (S(3) * c(2) + s * (S(4) * c(3))));
        return {S(1) + s * (c(0) + s * (c(1) + s * (c(2) + s * c(3)))), by_s, T{} + S(1)};
    }
    const T top = S(1) + s * (c(0) + s * (c(1) + s * c(4)));
    const T by_top = c(0) + s * (S(2) * c(1) + s * (S(3) * c(4)));
    if (!model.rational) return {top, by_top, T{} + S(1)};
    const T inverse = S(1) / (S(1) + s * (c(5) + s * (c(6) + s * c(7))));
    const T by_bottom = c(5) + s * (S(2) * c(6) + s * (S(3) * c(7))), gain = top * inverse;
    return {gain, (by_top - gain * by_bottom) * inverse, inverse};
}

// A point and its derivatives by the point that it comes from.
template <class T>
struct Mapped {
    T x, y, xx, xy, yx, yy;

    T determinant() const { return xx * yy - xy * yx; }
    // whether the symmetric part of the derivatives is positive definite (then the determinant is positive)
    auto definite() const {
        const T shear = Number<T>(0.5) * (xy + yx);
        return (xx + yy > T{}) & (xx * yy - shear * shear > T{});
    }
};

// Maps a chart point onto the sensor's normalized plane before its tilt. With g = (1 + k1 s + k2 s² + k3 s³) / (1 + k4
// s + k5 s² + k6 s³), s = x² + y²: xd = g x + 2 p1 x y + p2 (s + 2 x²) + s1 s + s2 s² yd = g y + p1 (s + 2 y²) + 2 p2 x
// y + s3 s + s4 s² the fisheye's g = 1 + k1 s + k2 s² + k3 s³ + k4 s⁴ with s = θ².
template <class T>
Mapped<T> distorted(const Model& model, T x, T y) {
    using S = Number<T>;
    if (model.path == Path::none) return {x, y, T{} + S(1), T{}, T{}, T{} + S(1)};
    const T s = x * x + y * y;
    Gain<T> gain = radial(model, s);
    const T along_x = S(2) * gain.by_s * x, along_y = S(2) * gain.by_s * y;
    if (model.path == Path::radial) {
        const T shear = x * along_y;
        return {x * gain.value, y * gain.value, gain.value + x * along_x, shear, shear, gain.value + y * along_y};
    }
    const auto c = [&](int i) { return S(model.coefficients[i]); };
    const S p1 = c(2), p2 = c(3), s1 = c(8), s2 = c(9), s3 = c(10), s4 = c(11);
    gain.value += S(2) * (p1 * y + p2 * x);
    const T shear = x * (along_y + S(2) * p1) + S(2) * p2 * y;
    const T prism_x = S(2) * s1 + S(4) * s2 * s, prism_y = S(2) * s3 + S(4) * s4 * s;
    return {x * gain.value + s * (p2 + s1 + s2 * s),
            y * gain.value + s * (p1 + s3 + s4 * s),
            gain.value + x * (along_x + S(4) * p2 + prism_x),
            shear + y * prism_x,
            shear + x * prism_y,
            gain.value + y * (along_y + S(4) * p1 + prism_y)};
}

// A point of the untilted plane on the tilted sensor; `depth` is positive where it is in front of that.
template <class T>
Mapped<T> tilted(const Model& model, T x, T y, T& depth) {
    using S = Number<T>;
    const auto r = [&](int i) { return S(model.turn[i]); };
    depth = r(6) * x + r(7) * y + r(8);
    const T scale = r(8) / depth;
    const T p = (r(0) * x + r(1) * y + r(2)) / depth, q = (r(3) * x + r(4) * y + r(5)) / depth;
    return {r(8) * p - r(2),           r(8) * q - r(5),           scale * (r(0) - p * r(6)),
            scale * (r(1) - p * r(7)), scale * (r(3) - q * r(6)), scale * (r(4) - q * r(7))};
}

// The inverse of `tilted`, without derivatives.
template <class T>
void untilt(const Model& model, T& x, T& y, T& depth) {
    using S = Number<T>;
    const auto r = [&](int i) { return S(model.turn[i]); };
    const T a = (x + r(2)) / r(8), b = (y + r(5)) / r(8);
    depth = r(2) * a + r(5) * b + r(8);
    x = (r(0) * a + r(3) * b + r(6)) / depth;
    y = (r(1) * a + r(4) * b + r(7)) / depth;
}

// A chart point on the sensor's normalized plane with its derivatives by the chart, and the two maps that lead there.
template <class T>
struct Sensed : Mapped<T> {
    Mapped<T> bent, turned;
    T depth;  // positive in front of the sensor
};

template <class T>
Sensed<T> on_sensor(const Model& model, const Mapped<T>& bent) {
    T depth = T{} + Number<T>(1);
    if (!model.tilted) return {bent, bent, bent, depth};
    const Mapped<T> t = tilted(model, bent.x, bent.y, depth);
    const Mapped<T> whole = {t.x,
                             t.y,
                             t.xx * bent.xx + t.xy * bent.yx,
                             t.xx * bent.xy + t.xy * bent.yy,
                             t.yx * bent.xx + t.yy * bent.yx,
                             t.yx * bent.xy + t.yy * bent.yy};
    return {whole, bent, t, depth};
}

template <class T>
Sensed<T> on_sensor(const Model& model, T x, T y) {
    return on_sensor(model, distorted(model, x, y));
}

// Calls put(i, x, y) with d(point on the sensor)/d(coefficient i), for each coefficient, of a chart point (x, y) with
// its map `at`.
template <class T, class Put>
void by_coefficients(const Model& model, T x, T y, const Sensed<T>& at, Put put) {
    const T s = x * x + y * y;
    if (model.fisheye) {
        T power = s;
        for (int i = 0; i < 4; ++i, power *= s) put(i, x * power, y * power);
        return;
    }
    const Mapped<T>& t = at.turned;
    const auto turned = [&](int i, T dx, T dy) {
        if (model.tilted) put(i, t.xx * dx + t.xy * dy, t.yx * dx + t.yy * dy);
        if (!model.tilted) put(i, dx, dy);
    };
    const Gain<T> gain = radial(model, s);
    const int count = model.distortions;
    const T first = s * gain.inverse, second = s * first, third = s * second, scale = -gain.value;
    if (count > 0) {
        turned(0, x * first, y * first), turned(1, x * second, y * second);
        turned(2, 2.0 * x * y, s + 2.0 * y * y), turned(3, s + 2.0 * x * x, 2.0 * x * y);
    }
    if (count > 4) turned(4, x * third, y * third);
    if (count > 5) {
        turned(5, scale * x * first, scale * y * first), turned(6, scale * x * second, scale * y * second);
        turned(7, scale * x * third, scale * y * third);
    }
    if (count > 8) turned(8, s, T{}), turned(9, s * s, T{}), turned(10, T{}, s), turned(11, T{}, s * s);
    if (!model.tilted) return;
    const auto& r = model.turn;  // [[cy, sy sx, −sy cx], [0, cx, sx], [sy, −cy sx, cy cx]]
    const double sx = r[5], cx = r[4], sy = r[6], cy = r[0];
    const double by_x[9] = {0.0, sy * cx, sy * sx, 0.0, -sx, cx, 0.0, -cy * cx, -cy * sx};
    const double by_y[9] = {-sy, cy * sx, -cy * cx, 0.0, 0.0, 0.0, cy, sy * sx, -sy * cx};
    const T p = (t.x + r[2]) / r[8], q = (t.y + r[5]) / r[8];
    for (const auto* d : {&by_x, &by_y}) {
        const auto row = [&](int i) { return (*d)[i] * at.bent.x + (*d)[i + 1] * at.bent.y + (*d)[i + 2]; };
        const T dx = r[8] * (row(0) - p * row(6)) / at.depth + (*d)[8] * p - (*d)[2];
        put(d == &by_x ? 12 : 13, dx, r[8] * (row(3) - q * row(6)) / at.depth + (*d)[8] * q - (*d)[5]);
    }
}

}  // namespace vbaa::lens
