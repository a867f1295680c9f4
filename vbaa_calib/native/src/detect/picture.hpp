// A picture as it is taken: grey or colour, of any depth.
#pragma once

#include <cstdint>
#include <variant>

#include "arrays.hpp"

namespace vbaa::detect {

// Levels of one kind of number, (H, W, channels).
template <class T>
using Levels = View<const T, 3>;

// `std::visit` calls a function with its levels.
using Picture = std::variant<Levels<std::uint8_t>, Levels<std::uint16_t>, Levels<float>, Levels<double>>;

}  // namespace vbaa::detect
