#include "solver/motion.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace vbaa::solver {
namespace {

// Degree of the path about which points should scatter by their standard deviations, and the fewest frames that can
// test it.
constexpr int PATH = 4, TESTED = 7;
constexpr double QUARTER = 1.5707963267948966;  // of a period, rad

// Frames from `first` up to `end` that count for the one at `centre`; `enough` for a parabola.
struct Neighbours {
    int centre, first, end;
    bool enough;

    int count() const { return end - first; }
};

Neighbours neighbours_of(ConstVector time_s, int centre, double reach_s, double longest_s, int most, bool live) {
    const int least = live ? 2 : 1, frames = time_s.size();
    int first = centre, end = centre + 1;
    const auto follows = [&](int i) {
        const double gap = time_s[i] - time_s[i - 1];
        return 0.0 < gap && gap <= longest_s;
    };
    while (first > std::max(centre - most, 0) && follows(first)) {
        if (time_s[centre] - time_s[first - 1] > reach_s && centre - first >= least) break;
        --first;
    }
    while (!live && end <= std::min(centre + most, frames - 1) && follows(end)) {
        if (time_s[end] - time_s[centre] > reach_s && end - centre > least) break;
        ++end;
    }
    return {centre, first, end, centre - first >= least && (live || end - centre > least)};
}

// Polynomials of rising degree, (PATH + 1, frames), orthonormal over frames at times (frames,) relative to the middle
// one by so many; gives the quadratic one's leading factor. Those beyond the parabola test the scatter.
double orthonormal(const Neighbours& near, ConstVector time_s, int degree, double farthest_s, Matrix powers) {
    const int count = near.count();
    double lower[PATH + 1][PATH + 1] = {};
    for (int w = 0; w < count; ++w) {
        powers(0, w) = 1.0;
        const double place = (time_s[near.first + w] - time_s[near.centre]) / farthest_s;
        for (int k = 1; k <= degree; ++k) powers(k, w) = powers(k - 1, w) * place;
    }
    for (int k = 0; k <= degree; ++k) {
        for (int j = 0; j <= k; ++j) {
            for (int w = 0; w < count; ++w) lower[k][j] += powers(k, w) * powers(j, w);
        }
    }
    // Cholesky's factor of their products, and the powers by it
    for (int k = 0; k <= degree; ++k) {
        for (int j = 0; j <= k; ++j) {
            for (int i = 0; i < j; ++i) lower[k][j] -= lower[k][i] * lower[j][i];
            lower[k][j] = j == k ? std::sqrt(lower[k][k]) : lower[k][j] / lower[j][j];
        }
        for (int w = 0; w < count; ++w) {
            for (int i = 0; i < k; ++i) powers(k, w) -= lower[k][i] * powers(i, w);
            powers(k, w) /= lower[k][k];
        }
    }
    return lower[2][2];
}

}  // namespace

void accelerations(const Moved& moved, const JudgedFrames& judged, const Accelerations& found) {
    constexpr double NOT_KNOWN = std::numeric_limits<double>::quiet_NaN();
    const ConstVector time_s = moved.time_s;
    const int pieces = moved.points.shape[1], wide = 3 * pieces;
    Array<double, 2> powers(PATH + 1, 2 * judged.most + 1), parts(PATH + 1, wide);
    Array<double, 1> squares(wide);
    fill(found.second, NOT_KNOWN);
    fill(found.deviation, NOT_KNOWN);
    fill(found.response, NOT_KNOWN);
    for (int r = 0; r < judged.frames.size(); ++r) {
        const int centre = static_cast<int>(judged.frames[r]);
        const double mode_rad_s = judged.mode_rad_s[r];
        const Neighbours near =
            neighbours_of(time_s, centre, QUARTER / mode_rad_s, judged.longest_s, judged.most, judged.live);
        if (!near.enough) continue;
        const int count = near.count(), first = near.first, degree = count >= TESTED ? PATH : 2;
        const double farthest_s = std::max(time_s[centre] - time_s[first], time_s[near.end - 1] - time_s[centre]);
        const double leading = orthonormal(near, time_s, degree, farthest_s, powers);
        const double scale = 2.0 / (farthest_s * farthest_s * leading);
        double seen = 0.0;
        fill(parts.view(), 0.0);
        fill(squares.view(), 0.0);
        const double* here = &moved.points(centre, 0, 0);
        for (int w = 0; w < count; ++w) {
            seen += powers(2, w) * std::cos(mode_rad_s * (time_s[first + w] - time_s[centre]));
            const double* there = &moved.points(first + w, 0, 0);
            for (int a = 0; a < wide; ++a) squares[a] += (there[a] - here[a]) * (there[a] - here[a]);
            for (int k = 0; k <= degree; ++k) {
                const double power = powers(k, w);
                double* part = &parts(k, 0);
                for (int a = 0; a < wide; ++a) part[a] += power * (there[a] - here[a]);
            }
        }
        found.response[r] = -scale * seen / (mode_rad_s * mode_rad_s);
        for (int g = 0; g < pieces; ++g) {
            double expected = 0.0, variance = 0.0;
            for (int w = 0; w < count; ++w) {
                const double one = moved.sigma(first + w, moved.sigma.shape[1] > 1 ? g : 0), own = one * one;
                expected += own;
                variance += powers(2, w) * powers(2, w) * own;
            }
            for (int axis = 0; axis < 3; ++axis) {
                const int a = 3 * g + axis;
                double left = squares[a];
                for (int k = 0; k <= degree; ++k) left -= parts(k, a) * parts(k, a);
                const double scatter = count >= TESTED ? left * count / (expected * (count - PATH - 1.0)) : 1.0;
                found.second(r, g, axis) = scale * parts(2, a);
                found.deviation(r, g, axis) = scale * std::sqrt(variance * std::max(scatter, 1.0));
            }
        }
    }
}

}  // namespace vbaa::solver
