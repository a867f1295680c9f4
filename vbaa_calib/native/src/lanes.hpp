// Packs of eight numbers, in one, two or four of the processor's own vectors: GCC keeps a wider vector type in
// memory, which is dozens of times slower.
#pragma once

#include <cmath>
#include <cstring>
#include <utility>

namespace vbaa {

constexpr int LANES = 8;

// The smallest multiple of LANES that is not below `count`.
constexpr int whole_lanes(int count) { return (count + LANES - 1) / LANES * LANES; }

// A processor vector of BYTES bytes.
template <class T, int BYTES>
struct Pack {
    static constexpr int VECTOR = __BIGGEST_ALIGNMENT__ < BYTES ? __BIGGEST_ALIGNMENT__ : BYTES;
    static constexpr int PARTS = BYTES / VECTOR, WIDTH = VECTOR / static_cast<int>(sizeof(T));
    using Part [[gnu::vector_size(VECTOR)]] = T;
    Part parts[PARTS];

    Pack() = default;
    Pack(T value) {
        for (Part& part : parts) part = Part{} + value;
    }

    T operator[](int lane) const { return parts[lane / WIDTH][lane % WIDTH]; }
    // One number to read or write.
    struct Lane {
        Part& part;
        int at;
        operator T() const { return part[at]; }
        Lane& operator=(T value) { return part[at] = value, *this; }
        Lane& operator=(const Lane& other) { return *this = static_cast<T>(other); }
    };
    Lane operator[](int lane) { return {parts[lane / WIDTH], lane % WIDTH}; }

    // A truth value for each number of a pack.
    struct Mask {
        using Part = decltype(Pack::Part{} < Pack::Part{});
        using Bytes [[gnu::vector_size(WIDTH)]] = signed char;
        Part parts[PARTS];

        struct Lane {
            Part& part;
            int at;
            operator bool() const { return part[at] != 0; }
            Lane& operator=(bool value) { return part[at] = value ? -1 : 0, *this; }
        };
        bool operator[](int lane) const { return parts[lane / WIDTH][lane % WIDTH] != 0; }
        Lane operator[](int lane) { return {parts[lane / WIDTH], lane % WIDTH}; }
        template <class Work>
        static Mask each(Work&& work) {
            Mask made;
            for (int k = 0; k < PARTS; ++k) made.parts[k] = work(k);
            return made;
        }
        friend Mask operator&(const Mask& a, const Mask& b) {
            return each([&](int k) { return a.parts[k] & b.parts[k]; });
        }
        friend Mask operator|(const Mask& a, const Mask& b) {
            return each([&](int k) { return a.parts[k] | b.parts[k]; });
        }
        Mask operator~() const {
            return each([&](int k) { return ~parts[k]; });
        }
        // whether any is true
        bool any() const {
            static constexpr char none[WIDTH] = {};
            Part every = parts[0];
            for (int k = 1; k < PARTS; ++k) every |= parts[k];
            const Bytes found = __builtin_convertvector(every, Bytes);
            return std::memcmp(&found, none, WIDTH) != 0;
        }
        // 1 for what is true, else 0, in as many bytes
        void put(bool* to) const {
            for (int k = 0; k < PARTS; ++k) {
                const Bytes found = __builtin_convertvector(parts[k], Bytes) & 1;
                std::memcpy(to + k * WIDTH, &found, WIDTH);
            }
        }
        Mask& operator&=(const Mask& other) { return *this = *this & other; }
        Mask& operator|=(const Mask& other) { return *this = *this | other; }
    };

    template <class Work>
    static Pack each(Work&& work) {
        Pack made;
        for (int k = 0; k < PARTS; ++k) made.parts[k] = work(k);
        return made;
    }
    friend Pack operator+(const Pack& a, const Pack& b) {
        return each([&](int k) { return a.parts[k] + b.parts[k]; });
    }
    friend Pack operator-(const Pack& a, const Pack& b) {
        return each([&](int k) { return a.parts[k] - b.parts[k]; });
    }
    friend Pack operator*(const Pack& a, const Pack& b) {
        return each([&](int k) { return a.parts[k] * b.parts[k]; });
    }
    friend Pack operator/(const Pack& a, const Pack& b) {
        return each([&](int k) { return a.parts[k] / b.parts[k]; });
    }
    Pack operator-() const {
        return each([&](int k) { return -parts[k]; });
    }
    Pack& operator+=(const Pack& other) { return *this = *this + other; }
    Pack& operator-=(const Pack& other) { return *this = *this - other; }
    Pack& operator*=(const Pack& other) { return *this = *this * other; }
    Pack& operator/=(const Pack& other) { return *this = *this / other; }
    friend Mask operator<(const Pack& a, const Pack& b) {
        return Mask::each([&](int k) { return a.parts[k] < b.parts[k]; });
    }
    friend Mask operator<=(const Pack& a, const Pack& b) {
        return Mask::each([&](int k) { return a.parts[k] <= b.parts[k]; });
    }
    friend Mask operator==(const Pack& a, const Pack& b) {
        return Mask::each([&](int k) { return a.parts[k] == b.parts[k]; });
    }
    friend Mask operator>(const Pack& a, const Pack& b) { return b < a; }
    friend Mask operator>=(const Pack& a, const Pack& b) { return b <= a; }
    // The values where the mask says so, the others elsewhere.
    friend Pack choose(const Mask& mask, const Pack& values, const Pack& others) {
        return each([&](int k) { return mask.parts[k] ? values.parts[k] : others.parts[k]; });
    }
    // A function applied to each number.
    template <class Work>
    Pack mapped(Work&& work) const {
        Pack made;
        for (int k = 0; k < PARTS; ++k) {
            for (int lane = 0; lane < WIDTH; ++lane) made.parts[k][lane] = work(parts[k][lane]);
        }
        return made;
    }
};

using Lanes = Pack<double, LANES * sizeof(double)>;
using FloatLanes = Pack<float, LANES * sizeof(double)>;  // sixteen

template <class T>
T choose(bool condition, T value, T other) {
    return condition ? value : other;
}

inline Lanes load(const double* from) {
    Lanes values;
    for (int k = 0; k < Lanes::PARTS; ++k) std::memcpy(&values.parts[k], from + k * Lanes::WIDTH, Lanes::VECTOR);
    return values;
}

inline void store(double* to, const Lanes& values) {
    for (int k = 0; k < Lanes::PARTS; ++k) std::memcpy(to + k * Lanes::WIDTH, &values.parts[k], Lanes::VECTOR);
}

inline Lanes spread(double value) { return value; }

// The values where the test is above 0, the others elsewhere and where it is not a number.
inline Lanes where_positive(const Lanes& test, const Lanes& values, const Lanes& others) {
    return choose(test > 0.0, values, others);
}

inline Lanes absolute(const Lanes& values) { return choose(values < 0.0, -values, values); }

inline double sum(const Lanes& values) {
    double total = 0.0;
    for (int lane = 0; lane < LANES; ++lane) total += values[lane];
    return total;
}

inline Lanes sqrt(const Lanes& values) {
    return values.mapped([](double value) { return std::sqrt(value); });
}
// By powers of two, which are a number's exponent, and Taylor's series of what is left, at most half of ln 2.
inline Lanes exp(const Lanes& values) {
    constexpr double least = -708.0, most = 709.0, by_ln2 = 1.4426950408889634;
    constexpr double ln2 = 0.693147180369123816490, ln2_rest = 1.90821492927058770002e-10;
    constexpr double inverse[] = {
        1.0,        1.0,         1.0 / 2,      1.0 / 6,       1.0 / 24,       1.0 / 120,       1.0 / 720,
        1.0 / 5040, 1.0 / 40320, 1.0 / 362880, 1.0 / 3628800, 1.0 / 39916800, 1.0 / 479001600, 1.0 / 6227020800.0};
    using Part = Lanes::Part;
    using Whole = Lanes::Mask::Part;
    const Lanes found = Lanes::each([&](int k) {
        const Part x = values.parts[k];
        // what is beyond, or not a number, is put right below
        const Part inside = x > least ? (x < most ? x : Part{} + most) : Part{} + least;
        const Whole power =
            __builtin_convertvector(inside * by_ln2 + (inside < 0.0 ? Part{} - 0.5 : Part{} + 0.5), Whole);
        const Part whole = __builtin_convertvector(power, Part);
        const Part rest = (inside - whole * ln2) - whole * ln2_rest;
        Part total = Part{} + inverse[13];
        for (int n = 12; n >= 0; --n) total = total * rest + inverse[n];
        const Whole bits = (power + 1023) << 52;
        Part scale;
        std::memcpy(&scale, &bits, sizeof scale);
        return total * scale;
    });
    const Lanes beyond = choose(values < least, spread(0.0), choose(values > most, INFINITY, found));
    return choose(values == values, beyond, values);
}
inline Lanes sin(const Lanes& values) {
    return values.mapped([](double value) { return std::sin(value); });
}
inline Lanes cos(const Lanes& values) {
    return values.mapped([](double value) { return std::cos(value); });
}

// The whole numbers below, or at, numbers that are not negative.
template <class T, int BYTES>
Pack<T, BYTES> truncated(const Pack<T, BYTES>& values, int* whole) {
    using Values = Pack<T, BYTES>;
    using Whole [[gnu::vector_size(Values::WIDTH * sizeof(int))]] = int;
    return Values::each([&](int k) {
        const Whole part = __builtin_convertvector(values.parts[k], Whole);
        std::memcpy(whole + k * Values::WIDTH, &part, sizeof part);
        return __builtin_convertvector(part, typename Values::Part);
    });
}

// The numbers at places of two processor vectors, counted through both.
template <int... PLACE>
Lanes::Part shuffled(const Lanes::Part& one, const Lanes::Part& other) {
#ifdef __clang__
    return __builtin_shufflevector(one, other, PLACE...);
#else
    return __builtin_shuffle(one, other, Lanes::Mask::Part{PLACE...});
#endif
}

// Sixteen numbers in pairs: the first of each, and the second.
template <int... LANE>
void unpair(const double* from, Lanes& first, Lanes& second, std::integer_sequence<int, LANE...>) {
    for (int k = 0; k < Lanes::PARTS; ++k) {
        Lanes::Part one, other;
        std::memcpy(&one, from + 2 * k * Lanes::WIDTH, sizeof one);
        std::memcpy(&other, from + (2 * k + 1) * Lanes::WIDTH, sizeof other);
        first.parts[k] = shuffled<(2 * LANE)...>(one, other);
        second.parts[k] = shuffled<(2 * LANE + 1)...>(one, other);
    }
}
inline void unpair(const double* from, Lanes& first, Lanes& second) {
    unpair(from, first, second, std::make_integer_sequence<int, Lanes::WIDTH>());
}

// Exchange the off-diagonal blocks of STEP × STEP numbers, of two rows STEP apart.
template <int STEP, int... LANE>
void exchange_blocks(Lanes& above, Lanes& below, std::integer_sequence<int, LANE...>) {
    constexpr int width = Lanes::WIDTH, parts = STEP / width;
    for (int k = 0; k < Lanes::PARTS; ++k) {
        Lanes::Part &one = above.parts[k], &other = below.parts[k];
        if constexpr (STEP < width) {
            const Lanes::Part was = one;
            one = shuffled<(LANE / STEP % 2 ? width + LANE - STEP : LANE)...>(was, other);
            other = shuffled<(LANE / STEP % 2 ? width + LANE : LANE + STEP)...>(was, other);
        } else if (k / parts % 2 == 0) {
            std::swap(above.parts[k + parts], other);
        }
    }
}

template <int STEP>
void exchange_blocks(Lanes& above, Lanes& below) {
    exchange_blocks<STEP>(above, below, std::make_integer_sequence<int, Lanes::WIDTH>());
}

// Exchange rows and columns of eight times eight numbers.
inline void transpose(Lanes (&rows)[LANES]) {
    for (int row = 0; row < LANES; row += 2) exchange_blocks<1>(rows[row], rows[row + 1]);
    for (int row = 0; row < LANES; ++row)
        if (row / 2 % 2 == 0) exchange_blocks<2>(rows[row], rows[row + 2]);
    for (int row = 0; row < LANES / 2; ++row) exchange_blocks<4>(rows[row], rows[row + 4]);
}

// Each of eight rows' sums; the rows are spoilt.
inline Lanes sums_of(Lanes (&rows)[LANES]) {
    for (int row = 0; row < LANES; row += 2) {
        exchange_blocks<1>(rows[row], rows[row + 1]);
        rows[row] += rows[row + 1];
    }
    for (int row = 0; row < LANES; row += 4) {
        exchange_blocks<2>(rows[row], rows[row + 2]);
        rows[row] += rows[row + 2];
    }
    exchange_blocks<4>(rows[0], rows[4]);
    return rows[0] + rows[4];
}

}  // namespace vbaa
