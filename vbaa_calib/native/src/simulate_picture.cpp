#include "simulate_picture.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace vbaa::simulate {

namespace {

constexpr double AMBIENT = 0.45;
// Distances beyond which pixels off the tube's edge, and samples outside the picture, are ignored.
constexpr double ROOM_PX = 2.5, BEYOND_PX = 50.0;

// A sample of the antenna's tube in the picture.
struct Sample {
    double u, v, tangent_u, tangent_v, normal_u, normal_v, half_width, light, depth;
};

// Within 2·10⁻⁸, from −1 to 1: M. Abramowitz and I. A. Stegun, Handbook of Mathematical Functions, 4.4.46.
double arc_sine(double u) {
    constexpr double of[] = {1.5707963050, -0.2145988016, 0.0889789874, -0.0501743046,
                             0.0308918810, -0.0170881256, 0.0066700901, -0.0012624911};
    const double x = std::abs(u);
    double total = of[7];
    for (int k = 6; k >= 0; --k) total = total * x + of[k];
    return std::copysign(of[0] - std::sqrt(1.0 - x) * total, u);
}

// The round tube's shading, integrated across it from its axis to u, −1 to 1.
double summed_shading(double u, double asymmetry) {
    const double round_part = (u * std::sqrt(1.0 - u * u) + arc_sine(u)) / 2;
    return AMBIENT * u + (1.0 - AMBIENT) * round_part + asymmetry * u * u / 2;
}

// Pixels around a tube, with the index of each one's nearest sample, −1 where none is near.
struct Near {
    int left, top;
    Array<int, 2> nearest;
};

Near nearest_samples(ConstMatrix curve, int width, int height) {
    double reach = ROOM_PX;
    for (int i = 0; i < curve.shape[0]; ++i) reach = std::max(reach, ROOM_PX + curve(i, 6));
    // the first pixel that a sample may reach, and one past the last
    auto first = [&](double place) { return static_cast<int>(std::max(place - reach, 0.0)); };
    auto last = [&](double place, int size) {
        return static_cast<int>(std::min(std::trunc(place + reach) + 2.0, static_cast<double>(size)));
    };
    const auto of_account = [&](int i) {
        const double u = curve(i, 0), v = curve(i, 1);
        return -BEYOND_PX < u && u < width + BEYOND_PX && -BEYOND_PX < v && v < height + BEYOND_PX;
    };
    int left = width, top = height, right = 0, bottom = 0;
    for (int i = 0; i < curve.shape[0]; ++i) {
        if (!of_account(i)) continue;
        left = std::min(left, first(curve(i, 0))), right = std::max(right, last(curve(i, 0), width));
        top = std::min(top, first(curve(i, 1))), bottom = std::max(bottom, last(curve(i, 1), height));
    }
    const int columns = std::max(right - left, 0), rows = std::max(bottom - top, 0);
    Near near = {left, top, Array<int, 2>(Unset{}, rows, columns)};
    std::fill(near.nearest.begin(), near.nearest.end(), -1);
    Array<float, 2> distance(Unset{}, rows, columns);
    std::fill(distance.begin(), distance.end(), static_cast<float>(reach * reach));
    for (int i = 0; i < curve.shape[0]; ++i) {
        if (!of_account(i)) continue;
        const auto u = static_cast<float>(curve(i, 0) - left), v = static_cast<float>(curve(i, 1) - top);
        const int begin = first(curve(i, 0)) - left, end = last(curve(i, 0), width) - left;
        for (int row = first(curve(i, 1)) - top; row < last(curve(i, 1), height) - top; ++row) {
            const float down = (static_cast<float>(row) - v) * (static_cast<float>(row) - v);
            float* const best = distance.row(row).data;
            int* const which = near.nearest.row(row).data;
            for (int column = begin; column < end; ++column) {
                const float across = static_cast<float>(column) - u, square = across * across + down;
                const bool nearer = square < best[column];
                best[column] = nearer ? square : best[column];
                which[column] = nearer ? i : which[column];
            }
        }
    }
    return near;
}

// Index mirrored at the border; the border's own pixel is repeated.
int mirrored(int place, int size) {
    if (place >= 0 && place < size) return place;
    const int within = (place % (2 * size) + 2 * size) % (2 * size);
    return within < size ? within : 2 * size - 1 - within;
}

// Index mirrored at the border; the border's own pixel is not repeated.
int reflected(int place, int size) {
    while (size > 1 && (place < 0 || place >= size)) place = place < 0 ? -place : 2 * (size - 1) - place;
    return size > 1 ? place : 0;
}

double square(double value) { return value * value; }

// Weights of the sub-pixels from `reach` before a pixel's first one on: a Gaussian, and the mean over the pixel.
struct Blur {
    int reach = 0;
    std::vector<float> weight;

    Blur(double sigma, int factor) {
        std::vector<double> bell = {1.0};
        if (sigma > 0.0) {
            reach = static_cast<int>(std::rint(8.0 * sigma + 1.0)) / 2;
            bell.clear();
            double whole = 0.0;
            for (int k = -reach; k <= reach; ++k) whole += bell.emplace_back(std::exp(-0.5 * square(k / sigma)));
            for (double& each : bell) each /= whole;
        }
        std::vector<double> sums(bell.size() + factor - 1);
        for (std::size_t k = 0; k < bell.size(); ++k)
            for (int i = 0; i < factor; ++i) sums[k + i] += bell[k] / factor;
        weight.assign(sums.begin(), sums.end());
    }
};

// Hash of a number, C. Wellons' triple32, used as random bits.
std::uint32_t hashed(std::uint32_t x) {
    x ^= x >> 17U;
    x *= 0xed5ad4bbU;
    x ^= x >> 11U;
    x *= 0xac4c1b51U;
    x ^= x >> 15U;
    x *= 0x31848babU;
    x ^= x >> 14U;
    return x;
}

// Normal numbers at equal steps of probability: the sum of two of them has the variance 1, and is normal as far as five
// deviations.
std::vector<float> normal_numbers(int count) {
    std::vector<double> found(count);
    double power = 0.0;
    for (int k = 0; k < count; ++k) {
        const double share = (k + 0.5) / count;
        double low = -5.0, high = 5.0;
        for (int halving = 0; halving < 50; ++halving) {
            const double middle = 0.5 * (low + high);
            (0.5 * std::erfc(-middle / std::sqrt(2.0)) < share ? low : high) = middle;
        }
        found[k] = 0.5 * (low + high);
        power += square(found[k]);
    }
    const double scale = std::sqrt(count / (2.0 * power));
    std::vector<float> numbers(count);
    for (int k = 0; k < count; ++k) numbers[k] = static_cast<float>(scale * found[k]);
    return numbers;
}

}  // namespace

std::array<double, 2> ray_between(ConstRays padded, double u, double v) {
    u = std::min(std::max(0.0, u + 1.0), padded.shape[1] - 1.001);
    v = std::min(std::max(0.0, v + 1.0), padded.shape[0] - 1.001);
    const int column = static_cast<int>(u), row = static_cast<int>(v);
    const double a = u - column, b = v - row;
    const float *const upper = &padded(row, column, 0), *const lower = &padded(row + 1, column, 0);
    const auto on_axis = [&](int j) {
        const double above = (1 - a) * upper[j] + a * upper[j + 2], below = (1 - a) * lower[j] + a * lower[j + 2];
        return (1 - b) * above + b * below;
    };
    return {on_axis(0), on_axis(1)};
}

Array<double, 2> rays_between(ConstRays padded, ConstMatrix pixels) {
    Array<double, 2> rays(Unset{}, pixels.shape[0], 2);
    for (int i = 0; i < pixels.shape[0]; ++i) {
        const auto ray = ray_between(padded, pixels(i, 0), pixels(i, 1));
        rays(i, 0) = ray[0], rays(i, 1) = ray[1];
    }
    return rays;
}

Array<float, 2> surroundings(ConstRays padded, const Rotation& R_world_camera, ConstPicture bench, double reach) {
    const int height = padded.shape[0] - 2, width = padded.shape[1] - 2, texels = bench.shape[0];
    const int middle = texels / 2;
    const auto half = static_cast<float>(middle), within = static_cast<float>(texels - 1);
    const float scaled = half / static_cast<float>(reach);
    constexpr float farthest = 1e6F;  // texels from the bench's middle
    float turn[3][3];
    for (int k = 0; k < 3; ++k) {
        const Point& row = R_world_camera.rows[k];
        turn[k][0] = static_cast<float>(row.x), turn[k][1] = static_cast<float>(row.y);
        turn[k][2] = static_cast<float>(row.z);
    }
    Array<float, 2> found(Unset{}, height, width);
    std::vector<float> both(2 * width);
    float* const __restrict across = both.data(), * const __restrict down = across + width;
    const float* const bright = bench.data;
    for (int row = 0; row < height; ++row) {
        const float* const rays = &padded(row + 1, 1, 0);
        for (int column = 0; column < width; ++column) {
            const float x = rays[2 * column], y = rays[2 * column + 1];
            const float u = turn[0][0] * x + turn[0][1] * y + turn[0][2];
            const float v = turn[1][0] * x + turn[1][1] * y + turn[1][2];
            const float w = turn[2][0] * x + turn[2][1] * y + turn[2][2];
            // scaled by 1/n, not normalised first: u = dx / (|d| − dz)
            const float scale = scaled / std::max(std::sqrt(u * u + v * v + w * w) - w, 1e-3F);
            across[column] = std::min(std::max(-farthest, u * scale + half), farthest);
            down[column] = std::min(std::max(-farthest, v * scale + half), farthest);
        }
        int beyond = 0;
        for (int k = 0; k < 2 * width; ++k) beyond += both[k] < 0.0F || both[k] >= within ? 1 : 0;
        float* const __restrict to = &found(row, 0);
        if (beyond == 0) {
            for (int column = 0; column < width; ++column) {
                const float u = across[column], v = down[column];
                const int left = static_cast<int>(u), top = static_cast<int>(v), at = top * texels + left;
                const float a = u - static_cast<float>(left), b = v - static_cast<float>(top);
                const float above = bright[at] + a * (bright[at + 1] - bright[at]);
                const float below = bright[at + texels] + a * (bright[at + texels + 1] - bright[at + texels]);
                to[column] = above + b * (below - above);
            }
            continue;
        }
        for (int column = 0; column < width; ++column) {
            const float u = across[column], v = down[column];
            const int left = static_cast<int>(std::floor(u)), top = static_cast<int>(std::floor(v));
            const float a = u - static_cast<float>(left), b = v - static_cast<float>(top);
            const int lefts[] = {mirrored(left, texels), mirrored(left + 1, texels)};
            const float *upper = &bench(mirrored(top, texels), 0), *lower = &bench(mirrored(top + 1, texels), 0);
            const float above = upper[lefts[0]] + a * (upper[lefts[1]] - upper[lefts[0]]);
            const float below = lower[lefts[0]] + a * (lower[lefts[1]] - lower[lefts[0]]);
            to[column] = above + b * (below - above);
        }
    }
    return found;
}

Array<float, 3> sheet_pixels(ConstRays padded, const Window& window, const Rotation& texel_from_ray,
                             View<const std::uint32_t, 2> blocks, const Print& print) {
    const int factor = window.factor, columns = window.columns, rows = window.rows * factor;
    const int stride = blocks.shape[1];
    const std::uint32_t* const paper = blocks.data;
    const auto last_column = static_cast<float>(blocks.shape[1] - 1),
               last_row = static_cast<float>(blocks.shape[0] - 1);
    const int begin = print.begin * factor, end = print.end * factor;
    const auto ink = static_cast<float>(print.ink), more = static_cast<float>(print.paper - print.ink);
    Array<float, 3> found(Unset{}, 2, rows, factor * columns);
    // homogeneous places on the sheet along a row of pixels' centres, and between two of these rows
    std::array<std::vector<float>, 3> upper, lower, along;
    for (int k = 0; k < 3; ++k)
        upper[k].resize(columns + 2), lower[k].resize(columns + 2), along[k].resize(columns + 2);
    const auto fill_row = [&](int row, std::array<std::vector<float>, 3>& places) {
        const float* const rays = &padded(row, window.left, 0);
        for (int column = 0; column < columns + 2; ++column) {
            const Point at = texel_from_ray.turned(Point{rays[2 * column], rays[2 * column + 1], 1.0});
            places[0][column] = static_cast<float>(at.x + 2.0 * at.z);
            places[1][column] = static_cast<float>(at.y + 2.0 * at.z);
            places[2][column] = static_cast<float>(at.z);
        }
    };
    for (int k = 0; k < 2; ++k) {
        std::fill(&found(k, 0, 0), found.begin() + (k * rows + begin) * factor * columns, 0.0F);
        std::fill(found.begin() + (k * rows + end) * factor * columns,
                  found.begin() + (k + 1) * rows * factor * columns, 0.0F);
    }
    int filled = window.top + print.begin;
    fill_row(filled, upper), fill_row(filled + 1, lower);
    for (int row = begin; row < end; ++row) {
        const double v = (row + 0.5) / factor + window.top + 0.5;
        for (const int above = static_cast<int>(v); filled < above;) {
            std::swap(upper, lower);
            fill_row(++filled + 1, lower);
        }
        const auto b = static_cast<float>(v - filled);
        for (int k = 0; k < 3; ++k)
            for (int column = 0; column < columns + 2; ++column)
                along[k][column] = upper[k][column] + b * (lower[k][column] - upper[k][column]);
        for (int i = 0; i < factor; ++i) {
            const double u = (i + 0.5) / factor + 0.5;
            const int on = static_cast<int>(u);
            const auto a = static_cast<float>(u - on);
            const float *const x = &along[0][on], *const y = &along[1][on], *const z = &along[2][on];
            float* const __restrict lit = &found(0, row, i * columns);
            float* const __restrict there = &found(1, row, i * columns);
            for (int column = 0; column < columns; ++column) {
                const float depth = z[column] + a * (z[column + 1] - z[column]), inverse = 1.0F / depth;
                const float right = (x[column] + a * (x[column + 1] - x[column])) * inverse;
                const float below = (y[column] + a * (y[column + 1] - y[column])) * inverse;
                const float in_front = depth > 0.0F ? 1.0F : 0.0F;
                const float c = in_front * std::min(std::max(0.0F, right), last_column);
                const float r = in_front * std::min(std::max(0.0F, below), last_row);
                const int left = static_cast<int>(c), top = static_cast<int>(r);
                const float p = c - static_cast<float>(left), q = r - static_cast<float>(top);
                const std::uint32_t block = paper[top * stride + left];
                const auto bit = [](std::uint32_t which) { return static_cast<float>(static_cast<int>(which & 1U)); };
                const float one = bit(block), other = bit(block >> 1U), third = bit(block >> 2U),
                            fourth = bit(block >> 3U);
                const float first = one + p * (other - one), second = third + p * (fourth - third);
                // what is on the sheet, from the middle of the last texel beyond it to that of the first one on it
                const float wide = std::min(std::min(c - 1.0F, last_column - c), 1.0F);
                const float high = std::min(std::min(r - 1.0F, last_row - r), 1.0F);
                const float presence = std::max(wide, 0.0F) * std::max(high, 0.0F);
                lit[column] = ink * presence + more * (first + q * (second - first));
                there[column] = presence;
            }
        }
    }
    return found;
}

Array<float, 2> blurred_change(ConstPicture canvas, ConstPicture brightness, ConstPicture covered, const Window& window,
                               double sigma_px) {
    const int factor = window.factor, columns = window.columns, rows = window.rows;
    const Blur blur(sigma_px * factor, factor);
    const int reach = blur.reach, taps = static_cast<int>(blur.weight.size());
    // a row's sub-pixels by their place within a pixel, one pixel after the other, mirrored beyond the row's ends
    const int wide = columns * factor, before = (reach + factor - 1) / factor, padded = columns + 2 * before + 2;
    std::vector<float> phases(static_cast<std::size_t>(padded) * factor), between(columns + 2);
    const auto at = [&](int t) -> float& {
        const int place = t + before * factor;
        return phases[static_cast<std::size_t>(place % factor) * padded + place / factor];
    };
    Array<float, 2> across(rows * factor, columns);
    std::vector<char> there(rows * factor);
    for (int row = 0; row < rows * factor; ++row) {
        const float *const own = &brightness(row, 0), *const part = &covered(row, 0);
        int any = 0;
        for (int k = 0; k < wide; ++k) any += own[k] != 0.0F || part[k] != 0.0F ? 1 : 0;
        if (any == 0) continue;
        there[row] = 1;
        // pixels that the row lies in, and those that its blur reaches
        const auto empty = [&](int column) {
            bool all = true;
            for (int k = column; k < wide; k += columns) all = all && own[k] == 0.0F && part[k] == 0.0F;
            return all;
        };
        int inner = 0, outer = columns;
        while (empty(inner)) ++inner;
        while (empty(outer - 1)) --outer;
        const int begin = std::max(inner - before - 1, 0), end = std::min(outer + before + 1, columns);
        const float v = (static_cast<float>(row) + 0.5F) / static_cast<float>(factor) - 0.5F;
        const int up = std::clamp(static_cast<int>(std::floor(v)), 0, rows - 1), low = std::min(up + 1, rows - 1);
        const float b = std::clamp(v - static_cast<float>(up), 0.0F, 1.0F);
        const float* const upper = &canvas(window.top + up, window.left);
        const float* const lower = &canvas(window.top + low, window.left);
        for (int column = 0; column < columns; ++column)
            between[column + 1] = upper[column] + b * (lower[column] - upper[column]);
        between[0] = between[1], between[columns + 1] = between[columns];
        std::fill(phases.begin(), phases.end(), 0.0F);
        for (int i = 0; i < factor; ++i) {
            const float u = (static_cast<float>(i) + 0.5F) / static_cast<float>(factor) + 0.5F;
            const int on = u < 1.0F ? 0 : 1;
            const float a = u - static_cast<float>(on), *const behind = &between[on];
            const float *const bright = own + i * columns, *const share = part + i * columns;
            float* const __restrict phase = &phases[static_cast<std::size_t>(i) * padded + before];
            for (int column = inner; column < outer; ++column)
                phase[column] =
                    bright[column] - share[column] * (behind[column] + a * (behind[column + 1] - behind[column]));
        }
        for (int t = 1; t <= before * factor; ++t) {
            at(-t) = at(reflected(-t, wide));
            at(wide - 1 + t) = at(reflected(wide - 1 + t, wide));
        }
        float* const __restrict to = &across(row, 0);
        for (int k = 0; k < taps; ++k) {
            const int off = before * factor - reach + k;  // from the padded row's first pixel on
            const float* const from = &phases[static_cast<std::size_t>(off % factor) * padded + off / factor];
            const float weight = blur.weight[k];
            for (int column = begin; column < end; ++column) to[column] += weight * from[column];
        }
    }
    Array<float, 2> found(rows, columns);
    for (int row = 0; row < rows; ++row) {
        float* const __restrict to = &found(row, 0);
        for (int k = 0; k < taps; ++k) {
            const int from_row = reflected(row * factor - reach + k, rows * factor);
            if (!there[from_row]) continue;
            const float *const from = &across(from_row, 0), weight = blur.weight[k];
            for (int column = 0; column < columns; ++column) to[column] += weight * from[column];
        }
    }
    return found;
}

Array<std::uint8_t, 2> digitised(ConstPicture grey, double electrons_per_grey, double read_noise, std::uint32_t seed) {
    constexpr std::uint32_t bits_each = 12U, all = 1U << bits_each;
    static const std::vector<float> normal = normal_numbers(static_cast<int>(all));
    const float* const numbers = normal.data();
    const int height = grey.shape[0], width = grey.shape[1];
    const auto per_grey = static_cast<float>(1.0 / electrons_per_grey), read = static_cast<float>(square(read_noise));
    Array<std::uint8_t, 2> found(Unset{}, height, width);
    std::vector<float> noise(width);
    for (int row = 0; row < height; ++row) {
        const std::uint32_t first = hashed(hashed(seed) + static_cast<std::uint32_t>(row)), second = hashed(first);
        const float* const levels = &grey(row, 0);
        std::uint8_t* const to = &found(row, 0);
        for (int column = 0; column < width; ++column) {
            const std::uint32_t bits = hashed((first + static_cast<std::uint32_t>(column)) * 0x9e3779b1U ^ second);
            noise[column] = numbers[bits & (all - 1U)] + numbers[bits >> (32U - bits_each)];
        }
        for (int column = 0; column < width; ++column) {
            const float level = levels[column], sigma = std::sqrt(std::max(level, 0.0F) * per_grey + read);
            const float noisy = std::min(std::max(0.0F, level + sigma * noise[column]), 255.0F);
            to[column] = static_cast<std::uint8_t>(static_cast<int>(std::rint(noisy)));
        }
    }
    return found;
}

std::array<Array<double, 2>, 2> spline(ConstVector places, ConstMatrix points, ConstVector at) {
    const int count = places.shape[0], last = count - 1, axes = points.shape[1], all = at.shape[0];
    std::vector<double> step(last), below(count), middle(count), above(count), slopes(count);
    for (int i = 0; i < last; ++i) step[i] = places[i + 1] - places[i];
    std::array<Array<double, 2>, 2> found = {Array<double, 2>(all, axes), Array<double, 2>(all, axes)};
    std::vector<int> piece(all);
    for (int k = 0; k < all; ++k) {
        const double* const next = std::upper_bound(places.begin() + 1, places.end() - 1, at[k]);
        piece[k] = static_cast<int>(next - places.begin()) - 1;
    }
    for (int axis = 0; axis < axes; ++axis) {
        const auto rise = [&](int i) { return (points(i + 1, axis) - points(i, axis)) / step[i]; };
        for (int i = 1; i < last; ++i) {
            below[i] = step[i], middle[i] = 2.0 * (step[i - 1] + step[i]), above[i] = step[i - 1];
            slopes[i] = 3.0 * (step[i] * rise(i - 1) + step[i - 1] * rise(i));
        }
        // the same third derivative on both sides of the second place, and of the last but one
        const double first = step[0] + step[1], end = step[last - 1] + step[last - 2];
        middle[0] = step[1], above[0] = first;
        slopes[0] = ((step[0] + 2.0 * first) * step[1] * rise(0) + square(step[0]) * rise(1)) / first;
        middle[last] = step[last - 2], below[last] = end;
        slopes[last] =
            (square(step[last - 1]) * rise(last - 2) + (2.0 * end + step[last - 1]) * step[last - 2] * rise(last - 1)) /
            end;
        for (int i = 1; i < count; ++i) {
            const double part = below[i] / middle[i - 1];
            middle[i] -= part * above[i - 1];
            slopes[i] -= part * slopes[i - 1];
        }
        slopes[last] /= middle[last];
        for (int i = last - 1; i >= 0; --i) slopes[i] = (slopes[i] - above[i] * slopes[i + 1]) / middle[i];
        for (int k = 0; k < all; ++k) {
            const int i = piece[k];
            const double along = at[k] - places[i], mean = rise(i), bend = (slopes[i] + slopes[i + 1] - 2.0 * mean);
            const double third = bend / square(step[i]), second = (mean - slopes[i]) / step[i] - bend / step[i];
            found[0](k, axis) = points(i, axis) + along * (slopes[i] + along * (second + along * third));
            found[1](k, axis) = slopes[i] + along * (2.0 * second + 3.0 * along * third);
        }
    }
    return found;
}

std::vector<TubePart> tube_parts(ConstMatrix curve, int width, int height, int room, int factor, double asymmetry) {
    constexpr int stretch = 128;  // samples; the longer, the more of a part is empty
    Near near = nearest_samples(curve, width, height);
    const int last = curve.shape[0] - 1, each = factor * factor;
    const double half = 0.5 / factor;
    // first and last column and row of what each stretch touches
    struct Box {
        int left, top, right = -1, bottom = -1;
    };
    std::vector<Box> boxes(last / stretch + 1, Box{width, height});
    for (int i = 0; i < near.nearest.shape[0]; ++i) {
        for (int j = 0; j < near.nearest.shape[1]; ++j) {
            int& at = near.nearest(i, j);
            if (at < 0) continue;
            const auto tube = read<Sample>(&curve(at, 0));
            const int row = near.top + i, column = near.left + j;
            const double across = (column - tube.u) * tube.normal_u + (row - tube.v) * tube.normal_v;
            if (std::abs(across) > tube.half_width + std::sqrt(0.5)) {
                at = -1;
                continue;
            }
            Box& box = boxes[at / stretch];
            box = {std::min(box.left, column), std::min(box.top, row), std::max(box.right, column),
                   std::max(box.bottom, row)};
        }
    }
    std::vector<double> right(each), below(each), cover(each), shade(each);
    for (int j = 0; j < each; ++j) {
        const int column = j % factor, row = j / factor;
        right[j] = (column + 0.5) / factor - 0.5, below[j] = (row + 0.5) / factor - 0.5;
    }
    std::vector<TubePart> parts;
    std::vector<int> covered;
    std::vector<Point> seen;
    for (std::size_t own = 0; own < boxes.size(); ++own) {
        const Box& box = boxes[own];
        if (box.right < 0) continue;
        const int left = std::max(box.left - room, 0), columns = std::min(box.right + room + 1, width) - left;
        const int top = std::max(box.top - room, 0), rows = std::min(box.bottom + room + 1, height) - top;
        Array<float, 3> fine(2, rows * factor, columns * factor);
        covered.clear(), seen.clear();
        for (int row = box.top; row <= box.bottom; ++row) {
            for (int column = box.left; column <= box.right; ++column) {
                const int at = near.nearest(row - near.top, column - near.left);
                if (at < 0 || static_cast<std::size_t>(at / stretch) != own) continue;
                const auto tube = read<Sample>(&curve(at, 0));
                const double u = column - tube.u, v = row - tube.v, scale = tube.half_width * factor;
                const double across = u * tube.normal_u + v * tube.normal_v;
                for (int j = 0; j < each; ++j) {
                    const double x = across + right[j] * tube.normal_u + below[j] * tube.normal_v;
                    const double low = std::min(std::max((x - half) / tube.half_width, -1.0), 1.0);
                    const double high = std::min(std::max((x + half) / tube.half_width, -1.0), 1.0);
                    cover[j] = (high - low) * scale;
                    shade[j] = (summed_shading(high, asymmetry) - summed_shading(low, asymmetry)) * scale * tube.light;
                }
                for (int j = 0; (at == 0 || at == last) && j < each; ++j) {
                    const double along = (u + right[j]) * tube.tangent_u + (v + below[j]) * tube.tangent_v;
                    double present = 1.0;
                    if (at == 0) present = std::min(std::max(0.5 + along * factor, 0.0), 1.0);
                    if (at == last) present *= std::min(std::max(0.5 - along * factor, 0.0), 1.0);
                    cover[j] *= present, shade[j] *= present;
                }
                for (int j = 0; j < each; ++j) {
                    const int y = (row - top) * factor + j / factor, x = j % factor * columns + column - left;
                    fine(0, y, x) = static_cast<float>(shade[j]);
                    fine(1, y, x) = static_cast<float>(cover[j]);
                    if (cover[j] <= 0.0) continue;
                    covered.push_back(y * factor * columns + x);
                    seen.push_back({column + right[j], row + below[j], tube.depth});
                }
            }
        }
        const int count = static_cast<int>(covered.size());
        Array<int, 1> places(Unset{}, count);
        Array<double, 2> pixels(Unset{}, count, 3);
        std::copy(covered.begin(), covered.end(), places.begin());
        for (int k = 0; k < count; ++k) write(seen[k], &pixels(k, 0));
        parts.push_back({left, top, std::move(fine), std::move(places), std::move(pixels)});
    }
    return parts;
}

}  // namespace vbaa::simulate
