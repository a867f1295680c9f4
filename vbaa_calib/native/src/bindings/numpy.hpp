// NumPy's arrays as the core's: no copies, checked for kind and contiguity; shapes are the caller's to check.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <cstring>
#include <type_traits>

#include "arrays.hpp"

namespace vbaa {

namespace nb = nanobind;

template <class T, int N>
using Numpy = nb::ndarray<nb::numpy, T, nb::ndim<N>, nb::c_contig, nb::device::cpu>;

using InVector = Numpy<const double, 1>;
using InMatrix = Numpy<const double, 2>;
using InCube = Numpy<const double, 3>;
using OutVector = Numpy<double, 1>;
using OutMatrix = Numpy<double, 2>;
using OutCube = Numpy<double, 3>;

// A window on an array that Python keeps.
template <class... Kind>
auto view(const nb::ndarray<Kind...>& array) {
    using Found = nb::ndarray<Kind...>;
    constexpr int axes = Found::Config::N;
    View<typename Found::Scalar, axes> found;
    found.data = array.data();
    for (int axis = 0; axis < axes; ++axis) found.shape[axis] = static_cast<int>(array.shape(axis));
    return found;
}

// The same of an attribute of a Python object, such as a named tuple or a dataclass of arrays, which has to keep it.
template <class T, int N>
View<T, N> attribute(nb::handle object, const char* name) {
    constexpr int asked = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (std::is_const_v<T> ? 0 : PyBUF_WRITABLE);
    using Own = std::remove_const_t<T>;
    constexpr bool whole = std::is_integral_v<T>, positive = std::is_unsigned_v<T>;
    constexpr const char* kinds = std::is_same_v<Own, bool> ? "?" : !whole ? "fd" : positive ? "BHILQ" : "bhilq";
    const nb::object array = object.attr(name);
    Py_buffer buffer;
    const bool got = PyObject_GetBuffer(array.ptr(), &buffer, asked) == 0;
    if (!got) PyErr_Clear();
    if (!got || buffer.ndim != N || buffer.itemsize != sizeof(T) || !std::strchr(kinds, buffer.format[0])) {
        if (got) PyBuffer_Release(&buffer);
        nb::raise_type_error("%s is not a contiguous array of the right kind with %d axes", name, N);
    }
    View<T, N> found;
    found.data = static_cast<T*>(buffer.buf);
    for (int axis = 0; axis < N; ++axis) found.shape[axis] = static_cast<int>(buffer.shape[axis]);
    PyBuffer_Release(&buffer);
    return found;
}

template <class T>
T number(nb::handle object, const char* name) {
    return nb::cast<T>(object.attr(name));
}

// A new array for Python, which keeps what the core has made; as another kind of number of the same size, if asked for.
template <class As, class T, int N>
Numpy<As, N> to_numpy_as(Array<T, N>&& made) {
    static_assert(sizeof(As) == sizeof(T));
    auto* kept = new Array<T, N>(std::move(made));
    nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<Array<T, N>*>(p); });
    std::array<std::size_t, N> shape;
    for (int axis = 0; axis < N; ++axis) shape[axis] = kept->shape[axis];
    return Numpy<As, N>(reinterpret_cast<As*>(kept->values.data()), N, shape.data(), owner);
}

template <class T, int N>
Numpy<T, N> to_numpy(Array<T, N>&& made) {
    return to_numpy_as<T>(std::move(made));
}

// Marks (N,) as NumPy's bool.
inline Numpy<bool, 1> to_flags(Array<unsigned char, 1>&& made) { return to_numpy_as<bool>(std::move(made)); }

}  // namespace vbaa
