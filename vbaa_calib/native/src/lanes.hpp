// Eight numbers that the processor works on at once: AVX-512 in one go, others in two or four.
#pragma once

#include <cmath>
#include <cstring>

namespace vbaa {

constexpr int LANES = 8;
using Lanes = double __attribute__((vector_size(8 * sizeof(double))));

// The smallest multiple of LANES that holds so many numbers.
constexpr int whole_lanes(int count) { return (count + LANES - 1) / LANES * LANES; }

inline Lanes load(const double* from) {
    Lanes values;
    std::memcpy(&values, from, sizeof values);
    return values;
}

inline void store(double* to, Lanes values) { std::memcpy(to, &values, sizeof values); }

// What the processor has registers for. GCC takes operations on more apart, but some through single numbers in memory:
// equal numbers in all lanes and choices between lanes.
#if defined(__AVX512F__)
constexpr int PIECES = 1;
#elif defined(__AVX__)
constexpr int PIECES = 2;
#else
constexpr int PIECES = 4;
#endif
using Piece = double __attribute__((vector_size(sizeof(Lanes) / PIECES)));
struct Pieces {
    Piece piece[PIECES];
};

template <class To, class From>
To same_bits(From from) {
    static_assert(sizeof(To) == sizeof(From));
    To to;
    std::memcpy(&to, &from, sizeof to);
    return to;
}

inline Lanes spread(double value) {
    Pieces found;
    for (Piece& piece : found.piece) piece = Piece{} + value;
    return same_bits<Lanes>(found);
}

// The values where the test is above 0, the others elsewhere and where it is not a number.
inline Lanes where_positive(Lanes test, Lanes values, Lanes others) {
    auto tests = same_bits<Pieces>(test), found = same_bits<Pieces>(others), wanted = same_bits<Pieces>(values);
    for (int i = 0; i < PIECES; ++i) found.piece[i] = tests.piece[i] > Piece{} ? wanted.piece[i] : found.piece[i];
    return same_bits<Lanes>(found);
}
inline Lanes where_positive(Lanes test, double values, Lanes others) {
    return where_positive(test, spread(values), others);
}
inline Lanes where_positive(Lanes test, Lanes values, double others) {
    return where_positive(test, values, spread(others));
}
inline Lanes where_positive(Lanes test, double values, double others) {
    return where_positive(test, spread(values), spread(others));
}

inline Lanes absolute(Lanes values) { return values < Lanes{} ? -values : values; }

inline double sum(Lanes values) {
    double total = 0.0;
    for (int lane = 0; lane < LANES; ++lane) total += values[lane];
    return total;
}

inline Lanes sqrt(Lanes values) {
    for (int lane = 0; lane < LANES; ++lane) values[lane] = std::sqrt(values[lane]);
    return values;
}

inline Lanes exp(Lanes values) {
    for (int lane = 0; lane < LANES; ++lane) values[lane] = std::exp(values[lane]);
    return values;
}

inline Lanes sin(Lanes values) {
    for (int lane = 0; lane < LANES; ++lane) values[lane] = std::sin(values[lane]);
    return values;
}

inline Lanes cos(Lanes values) {
    for (int lane = 0; lane < LANES; ++lane) values[lane] = std::cos(values[lane]);
    return values;
}

}  // namespace vbaa
