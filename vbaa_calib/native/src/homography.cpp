// Homographies of a flat board to its picture, of which less than half of the corners may be wrong.
#include <algorithm>
#include <cmath>

#include "bundle.hpp"
#include "lanes.hpp"
#include "linear_algebra.hpp"

namespace vbaa::bundle {
namespace {

constexpr double LEAST_SIZE = 1e-300, RAYLEIGH_MEDIAN = 1.1774;
constexpr double BELOW_MEDIAN = 5.0 / RAYLEIGH_MEDIAN;  // distance over the median one up to which points are fitted
constexpr int LEAST_CORNERS = 4;                        // they fix a homography

struct Homography {
    double m[3][3] = {};

    Homography operator*(const Homography& by) const {
        Homography found;
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                for (int k = 0; k < 3; ++k) found.m[i][k] += m[i][j] * by.m[j][k];
        return found;
    }

    // The inverse up to scale; for a singular matrix one that fits nothing.
    Homography adjugate() const {
        Homography found;
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) {
                const int a = (i + 1) % 3, b = (i + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
                found.m[j][i] = m[a][c] * m[b][d] - m[a][d] * m[b][c];
            }
        return found;
    }
};

// Normalises points (N, 2) in place to mean zero and unit size (Hartley); returns the homography that does so.
Homography normalise(Matrix points) {
    const int count = points.shape[0];
    double x = 0.0, y = 0.0, square = 0.0;
    for (int n = 0; n < count; ++n) x += points(n, 0) / count, y += points(n, 1) / count;
    for (int n = 0; n < count; ++n) {
        points(n, 0) -= x, points(n, 1) -= y;
        square += points(n, 0) * points(n, 0) + points(n, 1) * points(n, 1);
    }
    const double scale = 1.0 / std::max(std::sqrt(0.5 * square / count), LEAST_SIZE);
    for (double& one : points) one *= scale;
    return {{{scale, 0.0, -scale * x}, {0.0, scale, -scale * y}, {0.0, 0.0, 1.0}}};
}

// The homography that takes a projective basis to four of the points (N, 2).
Homography basis(ConstMatrix points, const std::int64_t* pick) {
    const auto at = [&](int i) { return &points(static_cast<int>(pick[i % 3]), 0); };
    const double* fourth = &points(static_cast<int>(pick[3]), 0);
    Homography found;
    for (int i = 0; i < 3; ++i) {
        const double *p = at(i), *q = at(i + 1), *r = at(i + 2);
        const double weight = fourth[0] * (q[1] - r[1]) + fourth[1] * (r[0] - q[0]) + (q[0] * r[1] - q[1] * r[0]);
        found.m[0][i] = weight * p[0], found.m[1][i] = weight * p[1], found.m[2][i] = weight;
    }
    return found;
}

// Pairs of points as columns, in whole vectors.
struct Columns {
    int count;
    std::vector<double> x, y, u, v;

    Columns(ConstMatrix points, ConstMatrix image) : count(points.shape[0]) {
        for (auto* each : {&x, &y, &u, &v}) each->resize(whole_lanes(count));
        for (int n = 0; n < count; ++n) {
            x[n] = points(n, 0), y[n] = points(n, 1);
            u[n] = image(n, 0), v[n] = image(n, 1);
        }
    }

    // Distances of the images of the points under a homography from where they are, eight from `first` on.
    Lanes distances(const Homography& h, int first) const {
        const Lanes px = load(&x[first]), py = load(&y[first]);
        const auto row = [&](int i) { return h.m[i][0] * px + h.m[i][1] * py + h.m[i][2]; };
        const Lanes w = 1.0 / row(2), off_x = row(0) * w - load(&u[first]), off_y = row(1) * w - load(&v[first]);
        return sqrt(off_x * off_x + off_y * off_y);
    }
};

// The homography through four of the points (N, 2) that has the least median distance.
Homography least_median(ConstMatrix points, ConstMatrix image, const Columns& columns,
                        View<const std::int64_t, 2> picks) {
    const int count = points.shape[0];
    Homography best;
    best.m[0][0] = best.m[2][2] = NOT_KNOWN;
    double least = INFINITE;
    std::vector<double> distances(whole_lanes(count)), sorted;
    for (int pick = 0; pick < picks.shape[0]; ++pick) {
        const std::int64_t* own = &picks(pick, 0);
        const Homography trial = basis(image, own) * basis(points, own).adjugate();
        int worse = 0;
        for (int n = 0; n < count && 2 * worse <= count + 1; n += LANES) {
            const Lanes found = columns.distances(trial, n);
            store(&distances[n], found);
            for (int lane = 0; lane < LANES; ++lane) worse += !(found[lane] < least) && n + lane < count;
        }
        if (2 * worse > count + 1) continue;
        sorted.assign(distances.begin(), distances.begin() + count);
        const double middle = median(sorted);
        if (middle < least) best = trial, least = middle;
    }
    return best;
}

// The homography of least algebraic error over the points (N, 2) within the limit.
Homography least_squares(ConstMatrix points, ConstMatrix image, const std::vector<double>& distances, double limit) {
    double scatter[9][9] = {}, values[9], vectors[9][9];
    for (int n = 0; n < points.shape[0]; ++n) {
        if (!(distances[n] <= limit)) continue;
        const double x = points(n, 0), y = points(n, 1);
        for (int axis = 0; axis < 2; ++axis) {
            double row[9] = {};
            row[3 * axis] = x, row[3 * axis + 1] = y, row[3 * axis + 2] = 1.0;
            row[6] = -image(n, axis) * x, row[7] = -image(n, axis) * y, row[8] = -image(n, axis);
            for (int i = 0; i < 9; ++i)
                for (int j = 0; j < 9; ++j) scatter[i][j] += row[i] * row[j];
        }
    }
    symmetric_eigen(scatter, values, vectors);
    Homography found;
    for (int i = 0; i < 9; ++i) found.m[i / 3][i % 3] = vectors[i][0];
    return found;
}

}  // namespace

double homography(ConstMatrix points, ConstMatrix image, View<const std::int64_t, 2> picks, double division,
                  Matrix found) {
    const int count = points.shape[0];
    Array<double, 2> board(points), ideal(image);
    std::vector<double> stretch(count), distances(whole_lanes(count));
    for (int n = 0; n < count; ++n) {
        stretch[n] = 1.0 + division * (image(n, 0) * image(n, 0) + image(n, 1) * image(n, 1));
        ideal(n, 0) /= stretch[n], ideal(n, 1) /= stretch[n];
    }
    const Homography by_board = normalise(board), by_ideal = normalise(ideal);
    const Columns columns(board, ideal);
    Homography best = least_median(board, ideal, columns, picks);
    const auto measure = [&] {
        double total = 0.0;
        for (int n = 0; n < count; n += LANES) store(&distances[n], columns.distances(best, n));
        for (int n = 0; n < count; ++n) total += distances[n];
        return total;
    };
    for (int turn = 0; turn < 2; ++turn) {
        if (!std::isfinite(measure())) return NOT_KNOWN;
        std::vector<double> sorted(distances.begin(), distances.begin() + count);
        const double middle = median(sorted);
        // the four smallest distinct distances
        std::sort(sorted.begin(), sorted.end());
        const auto unique = std::unique(sorted.begin(), sorted.end());
        const auto fourth = unique - sorted.begin() < LEAST_CORNERS ? NOT_KNOWN : sorted[LEAST_CORNERS - 1];
        const double limit = fourth == fourth ? fourth : INFINITE;
        best = least_squares(board, ideal, distances, std::max(BELOW_MEDIAN * middle, limit));
    }
    measure();
    distances.resize(count);
    for (int n = 0; n < count; ++n) distances[n] *= std::abs(stretch[n]);
    const double scale = by_ideal.m[0][0];
    // its adjugate is the inverse times the square of the scale
    const Homography whole = by_ideal.adjugate() * best * by_board;
    for (int i = 0; i < 9; ++i) found(i / 3, i % 3) = whole.m[i / 3][i % 3] / (scale * scale);
    return median(distances) / (RAYLEIGH_MEDIAN * scale);
}

}  // namespace vbaa::bundle
