#include "detect/corner_covariance.hpp"

#include <algorithm>
#include <cmath>

#include "detect/selection.hpp"

namespace vbaa::detect {
namespace {

using Pair = std::array<double, 2>;
using Plane = Array<float, 2>;

// A matrix (2, 2).
struct Square {
    double a = 0.0, b = 0.0, c = 0.0, d = 0.0;

    double determinant() const { return a * d - b * c; }
    Square transposed() const { return {a, c, b, d}; }
    Square inverse() const {
        const double whole = determinant();
        return {d / whole, -b / whole, -c / whole, a / whole};
    }
    Square operator*(const Square& o) const {
        return {a * o.a + b * o.c, a * o.b + b * o.d, c * o.a + d * o.c, c * o.b + d * o.d};
    }
};

// The matrix with its singular values raised to `least`.
Square raised(const Square& m, double least) {
    const double alike = std::hypot(0.5 * (m.a + m.d), 0.5 * (m.c - m.b));
    const double unlike = std::hypot(0.5 * (m.a - m.d), 0.5 * (m.c + m.b));
    const double sum = std::atan2(0.5 * (m.c + m.b), 0.5 * (m.a - m.d)), difference = std::atan2(m.c - m.b, m.a + m.d);
    const double left = 0.5 * (difference + sum), right = 0.5 * (difference - sum);
    const double first = std::max(alike + unlike, least),
                 second = std::copysign(std::max(std::abs(alike - unlike), least), alike - unlike);
    const double cl = std::cos(left), sl = std::sin(left), cr = std::cos(right), sr = std::sin(right);
    return Square{cl, -sl, sl, cl} * Square{first, 0.0, 0.0, second} * Square{cr, -sr, sr, cr};
}

// A whole number of pixels, far outside of any picture for what is no number or too large.
int pixel(double place) { return static_cast<int>(bounded(place, -1e8, 1e8)); }

// (K, K) pixels from `first` to `last` around a place; border pixels are repeated.
template <class T>
Plane block(View<const T, 2> picture, int u, int v, int first, int last) {
    const int size = last - first + 1;
    Plane found(Unset{}, size, size);
    for (int r = 0; r < size; ++r) {
        const T* const row = &picture(std::clamp(v + first + r, 0, picture.shape[0] - 1), 0);
        float* const __restrict to = found.row(r).data;
        if (u + first >= 0 && u + last < picture.shape[1])
            for (int c = 0; c < size; ++c) to[c] = static_cast<float>(row[u + first + c]);
        else
            for (int c = 0; c < size; ++c)
                to[c] = static_cast<float>(row[std::clamp(u + first + c, 0, picture.shape[1] - 1)]);
    }
    return found;
}

// A block (K, K) with the kernel (1, middle, 1) along both axes, (K − 2, K − 2).
Plane folded(const Plane& from, float middle) {
    const int size = from.shape[0] - 2;
    Plane found(Unset{}, size, size);
    std::vector<float> sums(size + 2);
    for (int r = 0; r < size; ++r) {
        const float *one = from.row(r).data, *two = from.row(r + 1).data, *three = from.row(r + 2).data;
        for (int c = 0; c < size + 2; ++c) sums[c] = one[c] + middle * two[c] + three[c];
        float* const __restrict to = found.row(r).data;
        for (int c = 0; c < size; ++c) to[c] = sums[c] + middle * sums[c + 1] + sums[c + 2];
    }
    return found;
}

// The number below which a share of the others lies, between the two nearest.
double percentile(std::vector<float>& values, double share) {
    const double place = share * static_cast<double>(values.size() - 1);
    const auto below = values.begin() + static_cast<int>(place);
    std::nth_element(values.begin(), below, values.end());
    const float above = below + 1 == values.end() ? *below : *std::min_element(below + 1, values.end());
    return *below + (place - std::floor(place)) * (above - *below);
}

// Mean grey levels of black and white squares, and the variances of the noise there.
struct Noise {
    Pair level, variance;
};

// Variance of normal numbers from the smallest of their squares.
double trimmed(std::vector<float>& squares, const CornerNoise& model) {
    const int kept = std::max(static_cast<int>(model.flat_kept * static_cast<double>(squares.size())), 1);
    std::nth_element(squares.begin(), squares.begin() + kept - 1, squares.end());
    double sum = 0.0;
    for (auto one = squares.begin(); one < squares.begin() + kept; ++one) sum += *one;
    return sum / kept * model.trimming;
}

// Measured in some windows, from second differences along both axes, which remove blurred edges and uneven light.
Noise noise_of(View<const std::uint8_t, 2> image, ConstMatrix corners, View<const std::int64_t, 1> windows,
               const CornerNoise& model) {
    const int count = corners.shape[0], several = std::min(count, model.largest_sample);
    std::array<Numbers, 2> levels = {Numbers(several), Numbers(several)};
    std::vector<float> every;
    std::array<std::vector<float>, 2> flat;
    for (int k = 0; k < several; ++k) {
        const int n = several > 1 ? static_cast<int>(static_cast<std::int64_t>(k) * (count - 1) / (several - 1)) : 0;
        const int window = static_cast<int>(windows[n]);
        const int u = pixel(std::rint(corners(n, 0))), v = pixel(std::rint(corners(n, 1)));
        const Plane pixels = block(image, u, v, -window - 2, window + 2);
        const Plane grey = folded(pixels, 1.0F), rough = folded(pixels, -2.0F);
        std::vector<float> sorted(grey.begin(), grey.end());
        const double black = levels[0][k] = percentile(sorted, 0.08) / 9.0;
        const double white = levels[1][k] = percentile(sorted, 0.92) / 9.0;
        const float scale = static_cast<float>(1.0 / std::max(white - black, 1.0));
        for (int i = 0; i < grey.size(); ++i) {
            // second differences along both axes have 36 times the variance of a pixel
            const float off = rough[i] * rough[i] / 36.0F;
            const float share = (grey[i] / 9.0F - static_cast<float>(black)) * scale;
            every.push_back(off);
            for (int side = 0; side < 2; ++side)
                if (std::abs(share - static_cast<float>(side)) < model.flat) flat[side].push_back(off);
        }
    }
    Noise found;
    for (int side = 0; side < 2; ++side) {
        const bool enough = static_cast<int>(flat[side].size()) >= model.flat_pixels;
        found.level[side] = central(levels[side]);
        found.variance[side] = std::max(trimmed(enough ? flat[side] : every, model), model.least);
    }
    return found;
}

// Sums of products of two weights' planes (K, K) each.
Square products(const Plane* one, const Plane* other) {
    std::array<float, 4> sums = {};
    for (int i = 0; i < one[0].size(); ++i) {
        sums[0] += one[0][i] * other[0][i], sums[1] += one[0][i] * other[1][i];
        sums[2] += one[1][i] * other[0][i], sums[3] += one[1][i] * other[1][i];
    }
    return {sums[0], sums[1], sums[2], sums[3]};
}

// The equations of one corner.
struct Equations {
    std::array<Plane, 2> by_pixel;  // A, (K + 3, K + 3) each
    Square by_shift, curvature;     // J and M
};

// From the pixels (K + 3, K + 3) around a corner that lies (u, v) beyond the middle one.
Equations equations(const Plane& pixels, float u, float v, int window) {
    const int size = 2 * window + 1, wide = size + 2;
    Plane samples(Unset{}, wide, wide);
    std::array<Plane, 2> slopes = {Plane(Unset{}, wide, wide), Plane(Unset{}, wide, wide)};
    for (int r = 0; r < wide; ++r) {
        const float *const upper = pixels.row(r).data, *const lower = pixels.row(r + 1).data;
        float* const __restrict sample = samples.row(r).data, * const __restrict along_u = slopes[0].row(r).data;
        float* const __restrict along_v = slopes[1].row(r).data;
        for (int c = 0; c < wide; ++c) {
            const float above = upper[c + 1] - upper[c], below = lower[c + 1] - lower[c];
            const float left = lower[c] - upper[c], right = lower[c + 1] - upper[c + 1];
            sample[c] = upper[c] + u * above + v * (left + u * (below - above));
            along_u[c] = above + v * (below - above);
            along_v[c] = left + u * (right - left);
        }
    }
    std::vector<float> bell(size);
    for (int k = 0; k < size; ++k) bell[k] = static_cast<float>(std::exp(-square(k - window) / square(window)));
    // weights of the samples, by each of the two equations, with a margin of two
    std::array<Plane, 2> by_sample = {Plane(wide + 2, wide + 2), Plane(wide + 2, wide + 2)};
    std::array<float, 3> power = {};
    std::array<std::vector<float>, 4> weight;
    for (auto& each : weight) each.resize(size);
    for (int r = 0; r < size; ++r) {
        const float *const row = samples.row(r + 1).data, *const before = samples.row(r).data;
        const float *const after = samples.row(r + 2).data, down = static_cast<float>(r - window);
        for (int c = 0; c < size; ++c) {
            const float right = static_cast<float>(c - window), w = bell[r] * bell[c];
            const float x = 0.5F * (row[c + 2] - row[c]), y = 0.5F * (after[c + 1] - before[c + 1]);
            const float along = x * right + y * down;
            power[0] += w * x * x, power[1] += w * x * y, power[2] += w * y * y;
            weight[0][c] = 0.5F * w * (x * right + along), weight[1][c] = 0.5F * w * x * down;
            weight[2][c] = 0.5F * w * y * right, weight[3][c] = 0.5F * w * (y * down + along);
        }
        for (int i = 0; i < 2; ++i) {
            Plane& to = by_sample[i];
            const float *const by_x = weight[2 * i].data(), *const by_y = weight[2 * i + 1].data();
            float* const __restrict own = to.row(r + 2).data + 1;
            float* const __restrict above = to.row(r + 1).data + 2, * const __restrict below = to.row(r + 3).data + 2;
            for (int c = 0; c < size; ++c) own[c + 2] += by_x[c];
            for (int c = 0; c < size; ++c) own[c] -= by_x[c];
            for (int c = 0; c < size; ++c) below[c] += by_y[c];
            for (int c = 0; c < size; ++c) above[c] -= by_y[c];
        }
    }
    Equations found = {{Plane(Unset{}, wide + 1, wide + 1), Plane(Unset{}, wide + 1, wide + 1)},
                       {},
                       {power[0], power[1], power[1], power[2]}};
    std::array<double, 4> shift = {};
    for (int i = 0; i < 2; ++i) {
        for (int j = 0; j < 2; ++j)
            for (int r = 0; r < wide; ++r) {
                const float *const one = by_sample[i].row(r + 1).data + 1, *const other = slopes[j].row(r).data;
                float sum = 0.0F;
                for (int c = 0; c < wide; ++c) sum += one[c] * other[c];
                shift[2 * i + j] += sum;
            }
        // transposed bilinear interpolation
        for (int r = 0; r <= wide; ++r) {
            const float *const upper = by_sample[i].row(r).data, *const lower = by_sample[i].row(r + 1).data;
            float* const __restrict to = found.by_pixel[i].row(r).data;
            for (int c = 0; c <= wide; ++c)
                to[c] = v * (u * upper[c] + (1.0F - u) * upper[c + 1]) +
                        (1.0F - v) * (u * lower[c] + (1.0F - u) * lower[c + 1]);
        }
    }
    found.by_shift = {shift[0], shift[1], shift[2], shift[3]};
    return found;
}

// Weights (K + 2R, K + 2R) of a picture's pixels from those (K, K) of its smoothed ones, for a bell (2R + 1,).
Plane spread(const Plane& from, const std::vector<float>& bell) {
    const int size = from.shape[0], taps = static_cast<int>(bell.size()), wide = size + taps - 1;
    Plane across(size, wide), found(wide, wide);
    for (int r = 0; r < size; ++r)
        for (int k = 0; k < taps; ++k) {
            const float* const row = from.row(r).data;
            float* const __restrict to = across.row(r).data + k;
            for (int c = 0; c < size; ++c) to[c] += bell[k] * row[c];
        }
    for (int r = 0; r < size; ++r)
        for (int k = 0; k < taps; ++k) {
            const float* const row = across.row(r).data;
            float* const __restrict to = found.row(r + k).data;
            for (int c = 0; c < wide; ++c) to[c] += bell[k] * row[c];
        }
    return found;
}

}  // namespace

Array<double, 3> corner_covariances(View<const std::uint8_t, 2> image, View<const float, 2> smooth, ConstMatrix corners,
                                    View<const std::int64_t, 1> windows, const CornerNoise& model) {
    Array<double, 3> found(corners.shape[0], 2, 2);
    if (!corners.shape[0]) return found;
    const int reach = static_cast<int>(std::ceil(4.0 * model.smoothing_px));  // OpenCV's kernel ends there
    std::vector<double> bell(2 * reach + 1);
    for (int k = 0; k <= 2 * reach; ++k) bell[k] = std::exp(-0.5 * square((k - reach) / model.smoothing_px));
    double whole = 0.0;
    for (double each : bell) whole += each;
    std::vector<float> kernel(bell.size());
    std::transform(bell.begin(), bell.end(), kernel.begin(),
                   [&](double each) { return static_cast<float>(each / whole); });
    const Noise noise = noise_of(image, corners, windows, model);
    const float black = static_cast<float>(noise.level[0]), in_black = static_cast<float>(noise.variance[0]);
    const float more = static_cast<float>(noise.variance[1] - noise.variance[0]);
    const float scale = static_cast<float>(1.0 / std::max(noise.level[1] - noise.level[0], 1.0));
    for (int n = 0; n < corners.shape[0]; ++n) {
        const int window = static_cast<int>(windows[n]);
        const int u = pixel(std::floor(corners(n, 0))), v = pixel(std::floor(corners(n, 1)));
        const Equations own =
            equations(block(smooth, u, v, -window - 1, window + 2), static_cast<float>(corners(n, 0) - u),
                      static_cast<float>(corners(n, 1) - v), window);
        const Square& m = own.curvature;
        const double size = std::max(m.a + m.d, 1e-3);
        if (!(m.determinant() > model.least_fixed * size * size)) {
            found(n, 0, 0) = found(n, 1, 1) = square(window);
            continue;
        }
        const std::array<Plane, 2> by_raw = {spread(own.by_pixel[0], kernel), spread(own.by_pixel[1], kernel)};
        std::array<Plane, 2> weighted = by_raw;
        const Plane raw = block(image, u, v, -window - 1 - reach, window + 2 + reach);
        for (int i = 0; i < raw.size(); ++i) {
            // photons' noise: linear in the grey level
            const float share = std::min(std::max(0.0F, (raw[i] - black) * scale), 1.0F);
            const float variance = in_black + share * more;
            weighted[0][i] *= variance, weighted[1][i] *= variance;
        }
        // J is bounded below by a part of M in every direction, beyond which it is not linear
        const Square inverse = (m * raised(m.inverse() * own.by_shift, model.least_kept)).inverse();
        const Square covariance = inverse * products(weighted.data(), by_raw.data()) * inverse.transposed();
        found(n, 0, 0) = covariance.a, found(n, 0, 1) = covariance.b;
        found(n, 1, 0) = covariance.c, found(n, 1, 1) = covariance.d;
    }
    return found;
}

}  // namespace vbaa::detect
