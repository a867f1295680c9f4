// Order statistics.
#pragma once

#include <algorithm>
#include <limits>
#include <vector>

namespace vbaa {

// Standard deviation of normal numbers over their median absolute value.
constexpr double MAD_SCALE = 1.4826;

// The n-th smallest number, counted from 0, NaN above all others, and of no numbers. Reorders them.
inline double nth_smallest(std::vector<double>& values, int n) {
    if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
    const auto below = [](double a, double b) { return a < b || (a == a && b != b); };
    std::nth_element(values.begin(), values.begin() + n, values.end(), below);
    return values[n];
}

}  // namespace vbaa
