// Log odds of an antenna at offsets from a path, in a strip of a picture along it: by the colours at its edges and by
// its usual colours.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>

#include "detect/picture.hpp"
#include "detect/selection.hpp"

namespace vbaa::detect {

// Priors of edges and colours; grey levels of 8 bits, in luma and, of colour pictures, two colour differences.
struct EdgeModel {
    double spread = 0.0;          // deviation of the colours of different surfaces
    double rate = 0.0;            // share of places of a background at which there is an edge
    double hidden = 0.0;          // least log odds of a place: the antenna may be hidden there
    double hidden_root = 0.0;     // the same over its first fifth, where hardly anything hides it
    double correlation_px = 0.0;  // along which log odds count once
    double strain = 0.0;          // deviation of its surface's strain where it is bent the most
    double look = 0.0;            // most that the colour of a place counts
};

constexpr int MOST_CHANNELS = 3;
constexpr int LOOK_PLACES = 8;           // along the antenna, at which its looks are known
constexpr double ROOT = 0.22;            // first part, in which hardly anything hides an antenna
constexpr float LEAST_DEVIATION = 0.5f;  // of a difference: light is never quite even
constexpr float LEAST_VARIANCE = LEAST_DEVIATION * LEAST_DEVIATION;

using Colour = std::array<float, MOST_CHANNELS>;

// Luma and two differences of blue, green and red.
inline Colour opponent(float b, float g, float r) {
    return {(b + g + r) / 3.0f, 0.5f * (r - b), 0.25f * (2.0f * g - r - b)};
}

// Conversion of raw levels to colours of 8 bits; it is linear, so that linear operations may be applied to raw levels
// first.
template <class T>
struct Colours {
    Levels<T> levels;
    float scale = std::is_same_v<T, std::uint16_t> ? 1.0f / 257.0f : 1.0f;

    int channels() const { return levels.shape[2] >= MOST_CHANNELS ? MOST_CHANNELS : 1; }
    Colour of(const Colour& own) const {
        return channels() == 1 ? Colour{scale * own[0]} : opponent(scale * own[0], scale * own[1], scale * own[2]);
    }
    // Converts planes of levels in place; the channels' planes are `next` apart.
    void convert(float* planes, std::ptrdiff_t next, int count) const {
        float* const __restrict one = planes;
        float* const __restrict two = planes + next, * const __restrict three = two + next;
        if (channels() == 1)
            for (int i = 0; i < count; ++i) one[i] *= scale;
        else
            for (int i = 0; i < count; ++i) {
                const float b = scale * one[i], g = scale * two[i], r = scale * three[i];
                one[i] = (b + g + r) * (1.0f / 3.0f);
                two[i] = 0.5f * (r - b);
                three[i] = 0.25f * (2.0f * g - r - b);
            }
    }
};

// Tabulated log odds of an edge that allow for a background's own edges, by the log odds that do not.
struct EdgeOdds {
    static constexpr float LOW = -8.0f, HIGH = 12.0f;
    static constexpr int ROWS = 1024;
    std::array<float, ROWS + 1> table;

    explicit EdgeOdds(double rate) {
        for (int row = 0; row <= ROWS; ++row) {
            const double odds = LOW + static_cast<double>(HIGH - LOW) * row / ROWS;
            table[row] = static_cast<float>(-std::log((1.0 - rate) * std::exp(-odds) + rate));
        }
    }
    // Replaces log odds, less `less`, in place.
    void replace(float* odds, int count, float less) const {
        constexpr int SOME = 64;
        constexpr float scale = ROWS / (HIGH - LOW);
        int rows[SOME];
        for (int first = 0; first < count; first += SOME) {
            const int some = std::min(SOME, count - first);
            float* const own = odds + first;
            for (int i = 0; i < some; ++i) {
                const float place = (own[i] - (LOW + less)) * scale;
                rows[i] = static_cast<int>(std::min(std::max(0.0f, place), static_cast<float>(ROWS)));
            }
            for (int i = 0; i < some; ++i) own[i] = table[rows[i]];
        }
    }
};

// Log odds that a difference is an edge's, without a background's own edges: `rise` times its square, less `low`.
struct EdgeScale {
    float rise, low;
};

inline EdgeScale edge_scale(const EdgeModel& model, double variance) {
    const double all = variance + 2.0 * square(model.spread);
    return {static_cast<float>(0.5 / variance - 0.5 / all), static_cast<float>(0.5 * std::log(all / variance))};
}

// Usual colours of an antenna at a place: mean and variance of each channel.
struct UsualColours {
    Colour mean = {}, variance = {1.0f, 1.0f, 1.0f};
};

using Looks = std::array<UsualColours, LOOK_PLACES>;

// Usual colours from mean colours (b, g, r) and their standard deviation, (LOOK_PLACES, 4); lamps and shadows widen
// them.
inline Looks looks_of(ConstMatrix colours) {
    Looks looks;
    for (int p = 0; p < LOOK_PLACES; ++p) {
        const auto level = [&](int k) { return static_cast<float>(colours(p, k)); };
        auto& [mean, variance] = looks[p];
        mean = opponent(level(0), level(1), level(2));
        const float spread = level(3), hue = 4.0f + 0.15f * spread;
        variance[0] = spread * spread + 0.0625f * mean[0] * mean[0];
        for (int k = 1; k < MOST_CHANNELS; ++k) variance[k] = hue * hue + 0.09f * mean[k] * mean[k];
    }
    return looks;
}

// Log odds that a colour is the antenna's rather than any: quadratic in each channel.
struct LookOdds {
    static constexpr UsualColours WORLD = {{100.0f, 0.0f, 0.0f}, {3600.0f, 400.0f, 400.0f}};
    Colour second = {}, first = {};  // of each channel's level
    float constant = 0.0f;

    LookOdds(const UsualColours& own, int channels) {
        for (int k = 0; k < channels; ++k) {
            const float narrow = 0.5f / own.variance[k], wide = 0.5f / WORLD.variance[k];
            second[k] = wide - narrow;
            first[k] = 2.0f * (narrow * own.mean[k] - wide * WORLD.mean[k]);
            constant += wide * WORLD.mean[k] * WORLD.mean[k] - narrow * own.mean[k] * own.mean[k] +
                        0.5f * std::log(WORLD.variance[k] / own.variance[k]);
        }
    }
    // The contribution of one channel to the log odds.
    float operator()(int channel, float level) const { return (second[channel] * level + first[channel]) * level; }
};

constexpr double STRIP_STEP_PX = 0.5;  // across

// Log odds (S, M) of an antenna with its middle at an offset from a path (S, 2) along its normals.
struct Strip {
    Table path, normal;
    Array<float, 2> odds;
    double first = 0.0;  // offset (px) of the first ones; STRIP_STEP_PX to the next
};

// The model by which strips are made.
struct StripModel {
    double width_px;
    const Looks* looks;  // or none
    Colour noise;        // deviation of a pixel in each channel
    const EdgeModel& edges;
    const EdgeOdds& odds;
};

// The strip of offsets up to `reach_px` from a path.
template <class T>
Strip strip_along(const Colours<T>& picture, ConstMatrix path, double reach_px, const StripModel& model);

}  // namespace vbaa::detect
