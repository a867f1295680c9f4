#include "detect/evidence.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

namespace vbaa::detect {
namespace {

// Log odds of a place outside the picture.
constexpr float OUTSIDE = -1e4F;
// Windows across the ribbon, in its widths: half width of the inner one; distance of a flank's middle from the
// ribbon's, and half width of a flank.
constexpr double INNER = 0.3, FLANK = 1.0, FLANK_HALF = 0.25;
// Share of a window that must be within the picture.
constexpr float MOST = 0.6F;
// Number of pixels with correlated errors, since cameras smooth pictures.
constexpr double TOGETHER = 4.0;

// Columns that are worked on at once.
constexpr int BLOCK = 64;
using Block = float[BLOCK];

// exp and log by their leading bits and a polynomial, to 1e-4; of what is between -80 and 80.
inline float fast_exp(float x) {
    const float t = x * 1.44269504F + 127.0F;
    const auto whole = static_cast<std::int32_t>(t);
    const float part = t - static_cast<float>(whole);
    const float mantissa = 1.0F + part * (0.69589F + part * (0.22487F + part * 0.07944F));
    const std::uint32_t bits = static_cast<std::uint32_t>(whole) << 23U;
    float power;
    std::memcpy(&power, &bits, sizeof power);
    return power * mantissa;
}

inline float fast_log(float x) {
    std::uint32_t bits;
    std::memcpy(&bits, &x, sizeof bits);
    const float exponent = static_cast<float>(bits >> 23U) - 127.0F;
    const std::uint32_t fraction = (bits & 0x007fffffU) | 0x3f800000U;
    float m;
    std::memcpy(&m, &fraction, sizeof m);
    const float p = -2.496846F + m * (4.028548F + m * (-2.081214F + m * (0.628874F - m * 0.079158F)));
    return 0.69314718F * (exponent + p);
}

// Windows of one direction, in columns, and their inverse numbers of pixels.
struct Windows {
    int inner, flank, flank_half;
    float part, flank_part;
};

// Sums of a row over columns from -half to half, about a place `off` away.
void sums(const float* row, int off, int half, int count, float* __restrict to) {
    const float* first = row + off - half;
    for (int i = 0; i < count; ++i) to[i] = first[i];
    for (int k = 1; k <= 2 * half; ++k)
        for (int i = 0; i < count; ++i) to[i] += first[i + k];
}

// Sums over windows of one direction at one row: a row for each colour, for the square of the first, and for the number
// of known pixels.
struct Sums {
    Array<float, 2> line;                  // along the step
    Array<float, 2> inner, before, after;  // over the windows, in columns of blocks

    Sums(int rows, int padded, int blocks)
        : line(rows, padded), inner(rows, blocks), before(rows, blocks), after(rows, blocks) {}
};

// Odds for and against: by how much differences of colour are more likely between two surfaces than on one.
struct Odds {
    Block exponent, factor;

    Odds() {
        std::fill(exponent, exponent + BLOCK, 0.0F);
        std::fill(factor, factor + BLOCK, 1.0F);
    }
    void add(const float* difference, const float* variance, float spread) {
        for (int i = 0; i < BLOCK; ++i) {
            const float v = variance[i], wide = v + spread, inverse = 1.0F / (v * wide);
            exponent[i] += difference[i] * difference[i] * spread * inverse;
            factor[i] *= wide * wide * inverse;
        }
    }
    // one surface against two
    void invert(float* to) const {
        for (int i = 0; i < BLOCK; ++i) to[i] = std::sqrt(factor[i]) * fast_exp(-std::min(0.5F * exponent[i], 60.0F));
    }
};

// Log odds of a ribbon at a block of columns.
void weigh(const Sums& sums_of, int at, const Windows& windows, const RibbonModel& model, float* __restrict to) {
    const int channels = model.noise.shape[0];
    const float n = windows.part, m = windows.flank_part;
    const auto together = static_cast<float>(TOGETHER);
    Block own, left, right, along, length, mixed, variance, difference;
    const auto scatter = [&](const Array<float, 2>& window, float part, float* values) {
        const float *luma = &window(0, at), *squares = &window(channels, at);
        for (int i = 0; i < BLOCK; ++i) {
            const float mean = luma[i] * part;
            values[i] = std::max(squares[i] * part - mean * mean, 0.0F) * together * part;
        }
    };
    scatter(sums_of.inner, n, own);
    scatter(sums_of.before, m, left);
    scatter(sums_of.after, m, right);
    // position between the two flanks' colours that is nearest to the ribbon's
    std::fill(along, along + BLOCK, 0.0F);
    std::fill(length, length + BLOCK, 1e-3F);
    for (int c = 0; c < channels; ++c) {
        const float *inner = &sums_of.inner(c, at), *before = &sums_of.before(c, at), *after = &sums_of.after(c, at);
        const auto weight = static_cast<float>(1.0 / (model.shading[c] * model.shading[c] + 1e-3));
        for (int i = 0; i < BLOCK; ++i) {
            const float across = (after[i] - before[i]) * m;
            along[i] += weight * across * (inner[i] * n - before[i] * m);
            length[i] += weight * across * across;
        }
    }
    for (int i = 0; i < BLOCK; ++i) mixed[i] = std::min(std::max(along[i] / length[i], 0.0F), 1.0F);
    Odds first, second, edge;
    for (int c = 0; c < channels; ++c) {
        const float *inner = &sums_of.inner(c, at), *before = &sums_of.before(c, at), *after = &sums_of.after(c, at);
        const auto noise = static_cast<float>(model.noise[c] * model.noise[c]) * together * (n + m) +
                           2.0F * static_cast<float>(model.shading[c] * model.shading[c]);
        const auto spread = static_cast<float>(2.0 * model.spread[c] * model.spread[c]);
        // the scatter within windows is known only for the first channel; in the others it counts less
        const float share = c == 0 ? 1.0F : 0.1F;
        for (int i = 0; i < BLOCK; ++i) difference[i] = inner[i] * n - before[i] * m;
        for (int i = 0; i < BLOCK; ++i) variance[i] = noise + share * (own[i] + left[i]);
        first.add(difference, variance, spread);
        for (int i = 0; i < BLOCK; ++i) difference[i] = inner[i] * n - after[i] * m;
        for (int i = 0; i < BLOCK; ++i) variance[i] = noise + share * (own[i] + right[i]);
        second.add(difference, variance, spread);
        for (int i = 0; i < BLOCK; ++i)
            difference[i] = inner[i] * n - m * (before[i] + mixed[i] * (after[i] - before[i]));
        for (int i = 0; i < BLOCK; ++i) variance[i] = noise + share * (own[i] + 0.5F * (left[i] + right[i]));
        edge.add(difference, variance, spread);
    }
    Block one, other, mix;
    first.invert(one);
    second.invert(other);
    edge.invert(mix);
    const auto flat = static_cast<float>(model.flat), edges = static_cast<float>(model.edge);
    const auto chance = static_cast<float>(model.chance), gap = static_cast<float>(model.gap);
    const float *inside = &sums_of.inner(channels + 1, at), *on_left = &sums_of.before(channels + 1, at);
    const float* on_right = &sums_of.after(channels + 1, at);
    for (int i = 0; i < BLOCK; ++i) {
        const float odds = std::max(-fast_log(flat * one[i] * other[i] + edges * mix[i] + chance), gap);
        const float seen = std::min(on_left[i], on_right[i]) * m > MOST ? odds : std::min(odds, 0.0F);
        to[i] = inside[i] * n > MOST ? seen : OUTSIDE;
    }
}

}  // namespace

Array<float, 3> ribbon_evidence(View<const float, 3> planes, const RibbonModel& model) {
    const int channels = planes.shape[0], height = planes.shape[1], width = planes.shape[2];
    const double steepest = std::cos(slant_of(DIRECTIONS_DOWN - 1));
    const int margin = static_cast<int>(std::ceil(ROW_STEP + (FLANK + FLANK_HALF) * model.width_px / steepest)) + 3;
    const int padded = width + 2 * margin;
    // planes, squares of the first, and where they are known
    Array<float, 3> wide(channels + 2, height, padded);
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            for (int c = 0; c < channels; ++c) wide(c, y, x + margin) = planes(c, y, x);
            wide(channels, y, x + margin) = planes(0, y, x) * planes(0, y, x);
            wide(channels + 1, y, x + margin) = 1.0F;
        }
    }
    const int rows = height / ROW_STEP, blocks = (width + BLOCK - 1) / BLOCK * BLOCK;
    Array<float, 3> found(rows, DIRECTIONS_DOWN, width);
    Sums work(channels + 2, padded, blocks);
    Array<float, 1> odds(blocks);
    for (int j = 0; j < rows; ++j) {
        for (int k = 0; k < DIRECTIONS_DOWN; ++k) {
            const double shift = std::tan(slant_of(k)), slant = std::cos(slant_of(k));
            const double across = model.width_px / slant;
            Windows windows{static_cast<int>(std::rint(INNER * across)), static_cast<int>(std::rint(FLANK * across)),
                            static_cast<int>(std::rint(FLANK_HALF * across)), 0.0F, 0.0F};
            windows.part = 1.0F / static_cast<float>(ROW_STEP * (2 * windows.inner + 1));
            windows.flank_part = 1.0F / static_cast<float>(ROW_STEP * (2 * windows.flank_half + 1));
            const int reach = windows.flank + windows.flank_half;
            const int start = margin - reach, span = width + 2 * reach;
            for (int c = 0; c < channels + 2; ++c) {
                float* __restrict line = &work.line(c, start);
                std::fill(line, line + span, 0.0F);
                for (int r = 0; r < ROW_STEP; ++r) {
                    const int on = static_cast<int>(std::rint(shift * (r - 0.5 * (ROW_STEP - 1))));
                    const float* row = &wide(c, j * ROW_STEP + r, start) + on;
                    for (int i = 0; i < span; ++i) line[i] += row[i];
                }
                const float* middle = &work.line(c, margin);
                sums(middle, 0, windows.inner, width, &work.inner(c, 0));
                sums(middle, -windows.flank, windows.flank_half, width, &work.before(c, 0));
                sums(middle, windows.flank, windows.flank_half, width, &work.after(c, 0));
            }
            for (int at = 0; at < blocks; at += BLOCK) weigh(work, at, windows, model, &odds[at]);
            std::copy(odds.begin(), odds.begin() + width, &found(j, k, 0));
        }
    }
    return found;
}

}  // namespace vbaa::detect
