// Vectors of three numbers, or of three times eight: they stay in registers, so all of it is inline.
#pragma once

#include <array>
#include <cmath>
#include <cstring>

#include "lanes.hpp"

namespace vbaa {

template <class T>
struct Vec3 {
    T x, y, z;
};

using Point = Vec3<double>;
// Vectors of eight problems at once.
using Vectors = Vec3<Lanes>;

template <class A, class B>
[[gnu::always_inline]] inline auto operator+(const Vec3<A>& a, const Vec3<B>& b) {
    return Vec3<decltype(a.x + b.x)>{a.x + b.x, a.y + b.y, a.z + b.z};
}

template <class A, class B>
[[gnu::always_inline]] inline auto operator-(const Vec3<A>& a, const Vec3<B>& b) {
    return Vec3<decltype(a.x + b.x)>{a.x - b.x, a.y - b.y, a.z - b.z};
}

template <class T>
[[gnu::always_inline]] inline Vec3<T> operator-(const Vec3<T>& a) {
    return {-a.x, -a.y, -a.z};
}

template <class Factor, class T>
[[gnu::always_inline]] inline auto operator*(Factor factor, const Vec3<T>& a) {
    using Product = decltype(factor * a.x);
    if constexpr (sizeof(Product) > sizeof(Factor)) {
        Product all = spread(factor);
        return Vec3<Product>{all * a.x, all * a.y, all * a.z};
    } else {
        return Vec3<Product>{factor * a.x, factor * a.y, factor * a.z};
    }
}

template <class A, class B>
[[gnu::always_inline]] inline auto dot(const Vec3<A>& a, const Vec3<B>& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

template <class A, class B>
[[gnu::always_inline]] inline auto cross(const Vec3<A>& a, const Vec3<B>& b) {
    return Vec3<decltype(a.x * b.x)>{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

inline double norm(const Point& a) { return std::sqrt(dot(a, a)); }
inline Lanes norm(const Vectors& a) { return sqrt(dot(a, a)); }

template <class T>
Vec3<T> unit(const Vec3<T>& a) {
    return 1.0 / norm(a) * a;
}

inline Point lane(const Vectors& a, int i) { return {a.x[i], a.y[i], a.z[i]}; }

inline void set_lane(Vectors& a, int i, const Point& value) {
    a.x[i] = value.x;
    a.y[i] = value.y;
    a.z[i] = value.z;
}

// Copies a vector's numbers into an array, from a place on.
template <class T, std::size_t N>
void set(std::array<T, N>& values, int first, const Vec3<T>& a) {
    values[first] = a.x;
    values[first + 1] = a.y;
    values[first + 2] = a.z;
}

// Rotation matrix, as its rows.
struct Rotation {
    Point rows[3];

    template <class T>
    Vec3<T> turned(const Vec3<T>& a) const {
        return {dot(rows[0], a), dot(rows[1], a), dot(rows[2], a)};
    }
    // rotation by the inverse
    template <class T>
    Vec3<T> turned_back(const Vec3<T>& a) const {
        return a.x * rows[0] + a.y * rows[1] + a.z * rows[2];
    }
};

// A plain struct of numbers, such as a Point, from neighbours in an array, and back.
template <class To>
To read(const double* from) {
    To found;
    std::memcpy(&found, from, sizeof found);
    return found;
}
template <class From>
void write(const From& values, double* to) {
    std::memcpy(to, &values, sizeof values);
}

}  // namespace vbaa
