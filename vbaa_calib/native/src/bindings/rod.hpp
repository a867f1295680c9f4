// Conversions that the bindings of antenna and simulator share.
#pragma once

#include <nanobind/stl/tuple.h>

#include "../shooting.hpp"
#include "../taper.hpp"
#include "numpy.hpp"

namespace vbaa {

// A plain struct of numbers, such as a point or a matrix.
template <class To, int N>
To read_from(const Numpy<const double, N>& values) {
    require(values.size() == sizeof(To) / sizeof(double), "a vector or matrix has the wrong size");
    return read<To>(values.data());
}

// The taper from pieces, see vbaa_calib.antenna.taper.
inline antenna::Taper read_taper(ConstMatrix pieces) {
    require(antenna::sound_taper(pieces), "a taper is of pieces (P, 7), see taper.hpp");
    return antenna::taper_of(pieces);
}

// A rod as vbaa_calib.antenna.rod.RodNumbers has it.
inline antenna::Rod rod_of(nb::handle numbers) {
    auto clamp = attribute<const double, 2>(numbers, "clamp");
    require(clamp.size() == 9, "a rod's clamp is (3, 3)");
    auto field = [&](const char* name) { return number<double>(numbers, name); };
    auto pieces = attribute<const double, 2>(numbers, "pieces");
    require(antenna::sound_taper(pieces), "a rod's pieces are (P, 7), see taper.hpp");
    const double length_m = field("length_m");
    return {length_m,
            field("bend"),
            field("twist"),
            field("mass_per_length_kg_m"),
            field("curvature_y"),
            field("curvature_z"),
            read<Point>(clamp.data),
            read<Point>(clamp.data + 3),
            read<Point>(clamp.data + 6),
            antenna::slices_of(pieces, length_m)};
}

}  // namespace vbaa
