// What the antenna's and the simulator's bindings have in common.
#pragma once

#include <nanobind/stl/tuple.h>

#include "../shooting.hpp"
#include "numpy.hpp"

namespace vbaa {

// Refuse arrays that would be read or written outside their memory.
inline void check(bool fits, const char* otherwise) {
    if (!fits) throw nb::value_error(otherwise);
}

// What a computation gives, without the interpreter's lock.
template <class Computation>
auto unlocked(Computation computation) {
    nb::gil_scoped_release release;
    return computation();
}

// Arrays that the core has made, for Python.
template <class... Arrays>
auto arrays(Arrays&&... made) {
    return std::make_tuple(to_numpy(std::move(made))...);
}

// A plain struct of numbers, such as a point or a matrix.
template <class To, int N>
To read_from(const Numpy<const double, N>& values) {
    check(values.size() == sizeof(To) / sizeof(double), "a vector or matrix has the wrong size");
    return read<To>(values.data());
}

// A rod as vbaa_calib.antenna.rod.RodNumbers has it.
inline antenna::Rod rod_of(nb::handle numbers) {
    auto clamp = attribute<const double, 2>(numbers, "clamp");
    check(clamp.size() == 9, "a rod's clamp is (3, 3)");
    auto field = [&](const char* name) { return number<double>(numbers, name); };
    return {field("length_m"),          field("bend"),        field("twist"),          field("mass_per_length_kg_m"),
            field("curvature_y"),       field("curvature_z"), read<Point>(clamp.data), read<Point>(clamp.data + 3),
            read<Point>(clamp.data + 6)};
}

}  // namespace vbaa
