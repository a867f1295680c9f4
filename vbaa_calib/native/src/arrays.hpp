// Arrays as the core sees them: contiguous, in C's order, of up to three axes.
#pragma once

#include <array>
#include <cstddef>
#include <new>
#include <vector>

namespace vbaa {

// A window on numbers that somebody else keeps.
template <class T, int N>
struct View {
    T* data = nullptr;
    std::array<int, N> shape = {};

    View() = default;
    View(T* values, std::array<int, N> sizes) : data(values), shape(sizes) {}
    // a window to read through, of one to write through
    template <class U>
    View(const View<U, N>& other) : data(other.data), shape(other.shape) {}

    int size() const {
        int count = 1;
        for (int n : shape) count *= n;
        return count;
    }
    T* begin() const { return data; }
    T* end() const { return data + size(); }

    T& operator()(int i) const {
        static_assert(N == 1);
        return data[i];
    }
    T& operator[](int i) const {
        static_assert(N == 1);
        return data[i];
    }
    T& operator()(int i, int j) const {
        static_assert(N == 2);
        return data[static_cast<std::size_t>(i) * shape[1] + j];
    }
    T& operator()(int i, int j, int k) const {
        static_assert(N == 3);
        return data[(static_cast<std::size_t>(i) * shape[1] + j) * shape[2] + k];
    }
    // one of the first axis, as NumPy's array[i]
    View<T, N - 1> row(int i) const {
        static_assert(N > 1);
        View<T, N - 1> part;
        std::size_t stride = 1;
        for (int axis = 1; axis < N; ++axis) {
            part.shape[axis - 1] = shape[axis];
            stride *= shape[axis];
        }
        part.data = data + i * stride;
        return part;
    }
    // those from `first` on along the first axis, `count` of them
    View<T, N> part(int first, int count) const {
        View<T, N> found = *this;
        std::size_t stride = 1;
        for (int axis = 1; axis < N; ++axis) stride *= shape[axis];
        found.data = data + first * stride;
        found.shape[0] = count;
        return found;
    }
};

// Memory whose start is one of the processor's widest vectors'.
template <class T>
struct Aligned {
    using value_type = T;

    Aligned() = default;
    template <class U>
    Aligned(const Aligned<U>&) {}
    T* allocate(std::size_t count) { return static_cast<T*>(::operator new(count * sizeof(T), std::align_val_t(64))); }
    void deallocate(T* memory, std::size_t) { ::operator delete(memory, std::align_val_t(64)); }
    bool operator==(const Aligned&) const { return true; }
    bool operator!=(const Aligned&) const { return false; }
};

// Numbers of its own, zeros at first.
template <class T, int N>
struct Array {
    std::vector<T, Aligned<T>> values;
    std::array<int, N> shape = {};

    Array() = default;
    template <class... Sizes>
    explicit Array(Sizes... sizes) : shape{static_cast<int>(sizes)...} {
        static_assert(sizeof...(Sizes) == N);
        std::size_t count = 1;
        for (int n : shape) count *= n;
        values.resize(count);
    }
    // a copy of what a window shows
    template <class U>
    explicit Array(const View<U, N>& other) : values(other.begin(), other.end()), shape(other.shape) {}

    int size() const { return static_cast<int>(values.size()); }
    View<T, N> view() { return {values.data(), shape}; }
    View<const T, N> view() const { return {values.data(), shape}; }
    operator View<T, N>() { return view(); }
    operator View<const T, N>() const { return view(); }
    View<T, N - 1> row(int i) { return view().row(i); }
    View<const T, N - 1> row(int i) const { return view().row(i); }
    T* begin() { return values.data(); }
    T* end() { return values.data() + values.size(); }
    const T* begin() const { return values.data(); }
    const T* end() const { return values.data() + values.size(); }
    T& operator[](int i) { return values[i]; }
    const T& operator[](int i) const { return values[i]; }
    template <class... Places>
    T& operator()(Places... places) {
        return view()(places...);
    }
    template <class... Places>
    const T& operator()(Places... places) const {
        return view()(places...);
    }
};

using Vector = View<double, 1>;
using Matrix = View<double, 2>;
using Cube = View<double, 3>;
using ConstVector = View<const double, 1>;
using ConstMatrix = View<const double, 2>;
using ConstCube = View<const double, 3>;

template <class T, int N>
void fill(View<T, N> target, T value) {
    for (T& each : target) each = value;
}

inline void copy(ConstVector source, Vector target) {
    for (int i = 0; i < target.shape[0]; ++i) target[i] = source[i];
}

}  // namespace vbaa
