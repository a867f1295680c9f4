// What the antenna's and the simulator's bindings have in common.
#pragma once

#include "../shooting.hpp"
#include "numpy.hpp"

namespace vbaa {

// Refuse arrays that would be read or written outside their memory.
inline void check(bool fits, const char* otherwise) {
    if (!fits) throw nb::value_error(otherwise);
}

// A rod as vbaa_calib.antenna.rod.RodNumbers has it.
inline antenna::Rod rod_of(nb::handle numbers) {
    auto clamp = attribute<const double, 2>(numbers, "clamp");
    check(clamp.size() == 9, "a rod's clamp is (3, 3)");
    return {number<double>(numbers, "length_m"),
            number<double>(numbers, "bend"),
            number<double>(numbers, "twist"),
            number<double>(numbers, "mass_per_length_kg_m"),
            number<double>(numbers, "curvature_y"),
            number<double>(numbers, "curvature_z"),
            read<Point>(&clamp(0, 0)),
            read<Point>(&clamp(1, 0)),
            read<Point>(&clamp(2, 0))};
}

}  // namespace vbaa
