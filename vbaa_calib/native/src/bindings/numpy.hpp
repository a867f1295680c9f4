// NumPy's arrays as the core's: no copies, checked for kind and contiguity; shapes are the caller's to check.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>

#include "arrays.hpp"

namespace vbaa {

namespace nb = nanobind;

// Raise ValueError where a rule on an array's size does not hold: numbers outside its memory would be accessed.
inline void require(bool holds, const char* rule) {
    if (!holds) throw nb::value_error(rule);
}

// An array to write into is taken as it is or refused (TypeError), because results written into a converted copy
// would be lost.
template <class T, int N>
struct Numpy : nb::ndarray<nb::numpy, T, nb::ndim<N>, nb::c_contig, nb::device::cpu> {
    using Base = nb::ndarray<nb::numpy, T, nb::ndim<N>, nb::c_contig, nb::device::cpu>;
    using Base::Base;
    Numpy() = default;
    explicit Numpy(Base&& array) : Base(std::move(array)) {}
};

// Whether sizes, and their product, are whole numbers as the core counts them.
template <class Size>
bool countable(const Size* shape, std::size_t axes) {
    double all = 1.0;
    for (std::size_t axis = 0; axis < axes; ++axis) {
        if (static_cast<double>(shape[axis]) > std::numeric_limits<int>::max()) return false;
        all *= static_cast<double>(shape[axis]);
    }
    return all <= std::numeric_limits<int>::max();
}

using InVector = Numpy<const double, 1>;
using InMatrix = Numpy<const double, 2>;
using InCube = Numpy<const double, 3>;
using OutVector = Numpy<double, 1>;
using OutMatrix = Numpy<double, 2>;
using OutCube = Numpy<double, 3>;

// A view of an array that Python owns.
template <class... Kind>
auto view(const nb::ndarray<Kind...>& array) {
    using Found = nb::ndarray<Kind...>;
    constexpr int axes = Found::Config::N;
    View<typename Found::Scalar, axes> found;
    found.data = array.data();
    for (int axis = 0; axis < axes; ++axis) found.shape[axis] = static_cast<int>(array.shape(axis));
    return found;
}

// A view of an array attribute of a Python object, such as a named tuple or a dataclass, which owns it.
template <class T, int N>
View<T, N> attribute(nb::handle object, const char* name) {
    constexpr int asked = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (std::is_const_v<T> ? 0 : PyBUF_WRITABLE);
    using Own = std::remove_const_t<T>;
    constexpr bool whole = std::is_integral_v<T>, positive = std::is_unsigned_v<T>;
    constexpr const char* kinds = std::is_same_v<Own, bool> ? "?" : !whole ? "fd" : positive ? "BHILQ" : "bhilq";
    const nb::object array = object.attr(name);
    if (Py_REFCNT(array.ptr()) == 1) nb::raise_type_error("%s is made anew each time, nobody keeps it", name);
    Py_buffer buffer;
    const bool got = PyObject_GetBuffer(array.ptr(), &buffer, asked) == 0;
    if (!got) PyErr_Clear();
    if (!got || buffer.ndim != N || buffer.itemsize != sizeof(T) || !std::strchr(kinds, buffer.format[0]) ||
        !countable(buffer.shape, N)) {
        if (got) PyBuffer_Release(&buffer);
        nb::raise_type_error("%s is not a contiguous array of the right kind with %d axes", name, N);
    }
    View<T, N> found;
    found.data = static_cast<T*>(buffer.buf);
    for (int axis = 0; axis < N; ++axis) found.shape[axis] = static_cast<int>(buffer.shape[axis]);
    PyBuffer_Release(&buffer);
    return found;
}

// A view of a NumPy array of structures; checked for its length, unless any is allowed.
template <class Row>
View<Row, 1> structures(nb::handle array, int count = -1) {
    Py_buffer buffer;
    const bool got =
        PyObject_GetBuffer(array.ptr(), &buffer, PyBUF_C_CONTIGUOUS | (std::is_const_v<Row> ? 0 : PyBUF_WRITABLE)) == 0;
    if (!got) PyErr_Clear();
    const bool right = got && buffer.ndim == 1 && buffer.itemsize == sizeof(Row) && countable(buffer.shape, 1) &&
                       (count < 0 || buffer.shape[0] == count);
    const View<Row, 1> found =
        right ? View<Row, 1>{static_cast<Row*>(buffer.buf), {static_cast<int>(buffer.shape[0])}} : View<Row, 1>{};
    if (got) PyBuffer_Release(&buffer);
    if (!right) nb::raise_type_error("not a contiguous array of the structures that the core fills");
    return found;
}

template <class T>
T number(nb::handle object, const char* name) {
    T found{};
    if (!nb::try_cast(object.attr(name), found)) nb::raise_type_error("%s is no number of the right kind", name);
    return found;
}

// The result of a function that runs without the interpreter's lock.
template <class Work>
auto unlocked(const Work& work) {
    const nb::gil_scoped_release release;
    return work();
}

// A NumPy array that owns one of the core's arrays; on request as another kind of number of the same size.
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

template <class... Made>
nb::tuple arrays(Made&&... made) {
    return nb::make_tuple(to_numpy(std::move(made))...);
}

// Marks (N,) as NumPy's bool.
inline Numpy<bool, 1> to_flags(Array<unsigned char, 1>&& made) { return to_numpy_as<bool>(std::move(made)); }

}  // namespace vbaa

namespace nanobind::detail {

template <class T, int N>
struct type_caster<vbaa::Numpy<T, N>> {
    using Kind = vbaa::Numpy<T, N>;
    using Caster = type_caster<typename Kind::Base>;
    NB_TYPE_CASTER(Kind, Caster::Name)

    bool from_python(handle source, std::uint32_t flags, cleanup_list* cleanup) noexcept {
        Caster found;
        if constexpr (!std::is_const_v<T>) flags &= ~std::uint32_t(cast_flags::convert);
        if (!found.from_python(source, flags, cleanup)) return false;
        value = Kind(std::move(found.value));
        return value.is_valid() && vbaa::countable(value.shape_ptr(), N);
    }
    static handle from_cpp(const Kind& array, rv_policy policy, cleanup_list* cleanup) noexcept {
        return Caster::from_cpp(array, policy, cleanup);
    }
};

}  // namespace nanobind::detail

// Functions that bind one room each, as a submodule of the module that Python imports.
namespace vbaa {

void bind_lens(nb::module_& module);
void bind_bundle(nb::module_& module);
void bind_antenna(nb::module_& module);
void bind_simulate(nb::module_& module);
void bind_solver(nb::module_& module);
void bind_search(nb::module_& module);
void bind_surface(nb::module_& module);
void bind_profile(nb::module_& module);
void bind_table(nb::module_& module);
void bind_board(nb::module_& module);

}  // namespace vbaa
