// Newton's method for one small system of equations.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "lanes.hpp"

namespace vbaa {

template <int N>
using Numbers = std::array<double, N>;
template <int ROWS, int COLUMNS>
using Small = std::array<std::array<double, COLUMNS>, ROWS>;

// The largest absolute value, infinite where one is not finite.
template <std::size_t N>
double largest(const std::array<double, N>& values) {
    double size = 0.0;
    for (double value : values) {
        if (!std::isfinite(value)) return std::numeric_limits<double>::infinity();
        size = std::max(size, std::abs(value));
    }
    return size;
}
template <std::size_t ROWS, std::size_t COLUMNS>
double largest(const std::array<std::array<double, COLUMNS>, ROWS>& matrix) {
    double size = 0.0;
    for (const auto& row : matrix) size = std::max(size, largest(row));
    return size;
}

// Gaussian elimination with pivots, in place of `right`; false where the matrix is singular or not finite.
template <int N, int K>
bool eliminate(Small<N, N> matrix, Small<N, K>& right) {
    const double least = 1e-14 * largest(matrix);
    for (int column = 0; column < N; ++column) {
        int pivot = column;
        for (int row = column + 1; row < N; ++row)
            if (std::abs(matrix[row][column]) > std::abs(matrix[pivot][column])) pivot = row;
        double best = matrix[pivot][column];
        if (!(least < std::abs(best) && std::abs(best) < std::numeric_limits<double>::infinity())) return false;
        std::swap(matrix[column], matrix[pivot]);
        std::swap(right[column], right[pivot]);
        for (int row = column + 1; row < N; ++row) {
            double factor = matrix[row][column] / best;
            for (int j = column + 1; j < N; ++j) matrix[row][j] -= factor * matrix[column][j];
            for (int j = 0; j < K; ++j) right[row][j] -= factor * right[column][j];
        }
    }
    for (int row = N - 1; row >= 0; --row)
        for (int j = 0; j < K; ++j) {
            for (int i = row + 1; i < N; ++i) right[row][j] -= matrix[row][i] * right[i][j];
            right[row][j] /= matrix[row][row];
        }
    return std::isfinite(largest(right));
}

// Overwrite `right` with x, where matrix · x = right; of a singular matrix with the least squares' x. False where
// something is not finite; `right` is as it was then.
template <int N, int K>
bool solve(const Small<N, N>& matrix, Small<N, K>& right) {
    Small<N, K> x = right;
    if (!eliminate<N, K>(matrix, x)) {
        // a trace of damping gives the pseudo-inverse's solution
        Small<N, N> squared = {};
        x = {};
        double size = largest(matrix);
        for (int i = 0; i < N; ++i) {
            squared[i][i] = 1e-12 * size * size;
            for (int row = 0; row < N; ++row) {
                for (int j = 0; j < N; ++j) squared[i][j] += matrix[row][i] * matrix[row][j];
                for (int j = 0; j < K; ++j) x[i][j] += matrix[row][i] * right[row][j];
            }
        }
        if (!eliminate<N, K>(squared, x)) return false;
    }
    right = x;
    return true;
}

// Values of M residuals, and their difference quotients.
template <int M, int N>
struct Linearised {
    Numbers<M> values;
    Small<M, N> slopes;
};

// At x; the residual takes eight x at once, an array of N Lanes, and gives M of them. The differences are backward, so
// that a variable at its upper limit is differentiated from the allowed side.
template <int M, int N, class Residual>
Linearised<M, N> linearised(const Residual& residual, const Numbers<N>& x) {
    constexpr double difference = -1e-7;
    Linearised<M, N> found;
    // lane 0 of the first eight is x itself, each of the others has moved one variable
    for (int first = -1; first < N; first += LANES) {
        std::array<Lanes, N> trials;
        for (int j = 0; j < N; ++j) {
            trials[j] = spread(x[j]);
            if (first <= j && j < first + LANES) trials[j][j - first] = x[j] + difference;
        }
        std::array<Lanes, M> values = residual(trials);
        for (int i = 0; i < M; ++i) {
            if (first < 0) found.values[i] = values[i][0];
            for (int j = std::max(first, 0); j < std::min(first + LANES, N); ++j)
                found.slopes[i][j] = (values[i][j - first] - found.values[i]) / difference;
        }
    }
    return found;
}

// Damped Newton with difference quotients; overwrites x, where to start, with the solution and gives the largest
// absolute residual, infinite where one is not finite.
//
// Variables and residuals are scaled by the caller so that 1 is a typical size. The limits cut off steps. Without
// convergence x keeps its last value; the caller compares the residual with its tolerance.
template <int N, class Residual>
double newton(const Residual& residual, Numbers<N>& x, const Numbers<N>& lower, const Numbers<N>& upper,
              double tolerance) {
    constexpr int iterations = 30, halvings = 8;
    auto limited = [&](double value, int i) { return std::min(std::max(value, lower[i]), upper[i]); };
    for (int i = 0; i < N; ++i) x[i] = limited(x[i], i);
    Linearised<N, N> at = linearised<N, N>(residual, x);
    double size = largest(at.values);
    for (int iteration = 0; iteration < iterations && size > tolerance && std::isfinite(size); ++iteration) {
        Small<N, 1> step;
        for (int i = 0; i < N; ++i) step[i][0] = -at.values[i];
        if (!solve<N, 1>(at.slopes, step)) break;
        bool better = false;
        double share = 1.0;
        for (int halving = 0; halving < halvings && !better; ++halving, share *= 0.5) {
            Numbers<N> trial;
            for (int i = 0; i < N; ++i) trial[i] = limited(x[i] + share * step[i][0], i);
            Linearised<N, N> there = linearised<N, N>(residual, trial);
            better = largest(there.values) < size;
            if (better) {
                x = trial;
                at = there;
                size = largest(at.values);
            }
        }
        if (!better) break;
    }
    return size;
}

}  // namespace vbaa
