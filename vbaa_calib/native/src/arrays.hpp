// Arrays as the core sees them: contiguous, in C's order, of up to three axes.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <new>
#include <utility>
#include <vector>

namespace vbaa {

constexpr double INFINITE = std::numeric_limits<double>::infinity();
constexpr double NOT_KNOWN = std::numeric_limits<double>::quiet_NaN();

// A view of numbers that it does not own.
template <class T, int N>
struct View {
    T* data = nullptr;
    std::array<int, N> shape = {};

    View() = default;
    View(T* values, std::array<int, N> sizes) : data(values), shape(sizes) {}
    // a constant view, from a mutable one
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

// A thread's pool of free memory blocks by size: arrays of one picture come and go by the dozen, and malloc takes
// longer for blocks of this size than it takes to fill them.
class Blocks {
    static constexpr std::align_val_t ALIGNMENT{64};  // that of the processor's widest vectors
    static constexpr std::size_t LEAST = 1024;        // bytes; smaller ones are malloc's
    static constexpr std::size_t MOST = 16777216;     // bytes that a thread keeps: more made no picture faster
    static constexpr std::size_t SIZES = 15;          // from 1 kB to 16 MB, twice as large each
    // A free block, linked to the next.
    struct Block {
        Block* next;
    };
    struct Free {
        Block* first[SIZES];
        std::size_t bytes;
        bool closed;
    };
    struct Closing {
        ~Closing() {
            for (Block* block : mine.first)
                while (block) ::operator delete(std::exchange(block, block->next), ALIGNMENT);
            mine = {};
            mine.closed = true;
        }
    };
    // without a destructor: memory is released after the thread's other objects have gone, too
    static inline thread_local Free mine = {};

    // Size class of a block of this many bytes; SIZES where none is pooled.
    static std::size_t size_of(std::size_t bytes) {
        if (bytes <= LEAST / 2) return SIZES;
        std::size_t size = 0;
        while (size < SIZES && bytes > LEAST << size) ++size;
        return size;
    }

  public:
    static void* taken(std::size_t bytes) {
        const std::size_t size = size_of(bytes);
        if (size == SIZES) return ::operator new(bytes, ALIGNMENT);
        if (!mine.first[size]) return ::operator new(LEAST << size, ALIGNMENT);
        mine.bytes -= LEAST << size;
        return std::exchange(mine.first[size], mine.first[size]->next);
    }
    static void released(void* block, std::size_t bytes) {
        static thread_local Closing closing;
        const std::size_t size = size_of(bytes);
        if (size == SIZES || mine.closed || mine.bytes + (LEAST << size) > MOST) {
            ::operator delete(block, ALIGNMENT);
        } else {
            mine.first[size] = new (block) Block{mine.first[size]};
            mine.bytes += LEAST << size;
        }
    }
};

// An allocator aligned to the processor's widest vectors. Numbers made without a value are uninitialised.
template <class T>
struct Aligned {
    using value_type = T;

    Aligned() = default;
    template <class U>
    Aligned(const Aligned<U>&) {}
    T* allocate(std::size_t count) { return static_cast<T*>(Blocks::taken(count * sizeof(T))); }
    void deallocate(T* memory, std::size_t count) { Blocks::released(memory, count * sizeof(T)); }
    template <class U>
    void construct(U* place) {
        ::new (static_cast<void*>(place)) U;
    }
    template <class U, class... Words>
    void construct(U* place, Words&&... words) {
        ::new (static_cast<void*>(place)) U(std::forward<Words>(words)...);
    }
    bool operator==(const Aligned&) const { return true; }
    bool operator!=(const Aligned&) const { return false; }
};

// Tag for arrays left uninitialised, because they are written completely before they are read.
struct Unset {};

// An array that owns its numbers, initially zeros.
template <class T, int N>
struct Array {
    std::vector<T, Aligned<T>> values;
    std::array<int, N> shape = {};

    Array() = default;
    template <class... Sizes>
    explicit Array(Sizes... sizes) : Array(Unset{}, sizes...) {
        std::fill(values.begin(), values.end(), T{});
    }
    template <class... Sizes>
    explicit Array(Unset, Sizes... sizes) : shape{static_cast<int>(sizes)...} {
        static_assert(sizeof...(Sizes) == N);
        std::size_t count = 1;
        for (int n : shape) count *= n;
        values.resize(count);
    }
    // a copy of a view's numbers
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
