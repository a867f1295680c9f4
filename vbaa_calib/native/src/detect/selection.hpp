// Numbers of many profiles, and those of the profiles that are chosen.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "smooth.hpp"

namespace vbaa::detect {

using Numbers = Array<double, 1>;       // (N,) one a profile
using Table = Array<double, 2>;         // (N, T) one a profile's pixel
using Flags = Array<unsigned char, 1>;  // (N,) which profiles are chosen

// Quantile of profiles' residuals taken for the noise: most may lie next to an object.
constexpr double QUIET = 0.4;

inline double square(double value) { return value * value; }

// The value, but no less than `low`, also where it is NaN, and no more than `high`.
inline double bounded(double value, double low, double high) {
    const double raised = value > low ? value : low;
    return raised < high ? raised : high;
}

// (N,) a function of each index: doubles, or flags where it gives truth values.
template <class Function>
auto each(int count, Function function) {
    using Value = decltype(function(0));
    Array<std::conditional_t<std::is_same_v<Value, bool>, unsigned char, Value>, 1> values(Unset{}, count);
    for (int n = 0; n < count; ++n) values[n] = function(n);
    return values;
}

inline double total(ConstVector values) {
    double sum = 0.0;
    for (double value : values) sum += value;
    return sum;
}

inline int count(const Flags& chosen) {
    return static_cast<int>(std::count_if(chosen.begin(), chosen.end(), [](auto flag) { return flag != 0; }));
}

inline bool any(const Flags& chosen) { return count(chosen) > 0; }

// Indices (M,) of the chosen.
inline std::vector<int> places(const Flags& chosen) {
    std::vector<int> found;
    for (int n = 0; n < chosen.size(); ++n)
        if (chosen[n]) found.push_back(n);
    return found;
}

// The values (M,) of the chosen.
inline Numbers selected(ConstVector values, const Flags& chosen) {
    Numbers found(Unset{}, count(chosen));
    int k = 0;
    for (int n = 0; n < chosen.size(); ++n)
        if (chosen[n]) found[k++] = values[n];
    return found;
}

// The rows (M, C) of the chosen.
inline Table selected(ConstMatrix rows, const Flags& chosen) {
    Table found(Unset{}, count(chosen), rows.shape[1]);
    int k = 0;
    for (int n : places(chosen)) copy(rows.row(n), found.row(k++));
    return found;
}

// The median of values (N,), the mean of the two middle ones of an even number; NaN of none, or with NaN.
inline double central(Numbers values) {
    if (!values.size() || std::any_of(values.begin(), values.end(), [](double each) { return std::isnan(each); }))
        return NAN;
    const auto middle = values.values.begin() + values.size() / 2;
    std::nth_element(values.values.begin(), middle, values.values.end());
    return values.size() % 2 ? *middle : 0.5 * (*middle + *std::max_element(values.values.begin(), middle));
}

}  // namespace vbaa::detect
