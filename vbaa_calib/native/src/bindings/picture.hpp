// NumPy's pictures as the core's.
#pragma once

#include "bindings/numpy.hpp"
#include "detect/picture.hpp"

namespace vbaa {

using InPicture = nb::ndarray<nb::ro, nb::c_contig, nb::device::cpu>;

// A picture (H, W) or (H, W, channels) of uint8, uint16, float32 or float64, not empty.
inline detect::Picture picture(const InPicture& array) {
    if ((array.ndim() != 2 && array.ndim() != 3) || array.size() == 0)
        throw nb::value_error("a picture is an array (H, W) or (H, W, channels), not empty");
    require(array.size() < 1u << 30u, "a picture has less than 2^30 numbers");
    const std::array<int, 3> shape = {static_cast<int>(array.shape(0)), static_cast<int>(array.shape(1)),
                                      array.ndim() == 3 ? static_cast<int>(array.shape(2)) : 1};
    const auto levels = [&](auto kind) {
        return detect::Levels<decltype(kind)>(static_cast<const decltype(kind)*>(array.data()), shape);
    };
    if (array.dtype() == nb::dtype<std::uint8_t>()) return levels(std::uint8_t{});
    if (array.dtype() == nb::dtype<std::uint16_t>()) return levels(std::uint16_t{});
    if (array.dtype() == nb::dtype<float>()) return levels(float{});
    if (array.dtype() == nb::dtype<double>()) return levels(double{});
    throw nb::type_error("a picture is of uint8, uint16, float32 or float64");
}

}  // namespace vbaa
