// Python's `core.lens.Lens` (what `camera.lens.lens_of(intrinsics)` gives) as the core's lens, and room for results.
#pragma once

#include <algorithm>

#include "lens.hpp"
#include "numpy.hpp"

namespace vbaa {

// Refuse a number of parameters that no model has.
inline void check_lens(bool fisheye, int parameters) {
    constexpr int counts[] = {4, 8, 9, 12, 16, 18};
    require(fisheye ? parameters == 8 : std::count(std::begin(counts), std::end(counts), parameters) > 0,
            "a lens has 4, 8, 9, 12, 16 or 18 parameters, the fisheye 8");
}

// A new array of that shape for Python, its numbers not set.
template <class T, class... Sizes>
Numpy<T, sizeof...(Sizes)> room(Sizes... sizes) {
    const std::array<std::size_t, sizeof...(Sizes)> shape = {static_cast<std::size_t>(sizes)...};
    std::size_t count = 1;
    for (std::size_t size : shape) count *= size;
    T* values = new T[std::max<std::size_t>(count, 1)];
    nb::capsule owner(values, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    return Numpy<T, sizeof...(Sizes)>(values, shape.size(), shape.data(), owner);
}

// The size of the last axis, or ValueError.
template <class... Kind>
void check_last(const nb::ndarray<Kind...>& array, std::size_t size, const char* what) {
    if (array.shape(array.ndim() - 1) != size) throw nb::value_error(what);
}

}  // namespace vbaa
