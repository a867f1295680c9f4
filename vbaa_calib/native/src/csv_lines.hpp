// Numbers and words as lines of a CSV table.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "arrays.hpp"

namespace vbaa {

// Lines of numbers (B, K), each with the significant digits of its column, (K,), as printf's %g writes them; what is
// not finite is an empty cell. A column of 0 digits takes its cells from the next of the texts in place of numbers: one
// cell a line, quoted where necessary.
std::string csv_lines(ConstMatrix numbers, View<const int, 1> digits,
                      const std::vector<std::vector<std::string_view>>& texts);

}  // namespace vbaa
