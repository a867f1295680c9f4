// Deflate by Huffman codes alone: noise repeats nothing that a search would find.
#pragma once

#include <cstdint>

#include "arrays.hpp"

namespace vbaa::simulate {

// A deflate stream (RFC 1951) of bytes.
Array<std::uint8_t, 1> huffman_deflated(View<const std::uint8_t, 1> bytes);

}  // namespace vbaa::simulate
