// Python's `core.lens.Lens` (what `camera.lens.lens_of(intrinsics)` gives) as the core's lens, and room for results.
#pragma once

#include <algorithm>

#include "lens.hpp"
#include "numpy.hpp"

namespace vbaa {

// Lives as long as the Python object does.
inline const lens::Lens& lens_of(nb::handle object) { return nb::cast<const lens::Lens&>(object); }

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
