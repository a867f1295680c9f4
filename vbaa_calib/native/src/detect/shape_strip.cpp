#include "detect/shape_strip.hpp"

#include <cstring>

#include "polyline.hpp"

namespace vbaa::detect {
namespace {

constexpr double EDGE_GAP_PX = 0.4, EDGE_PX = 2.0;  // px next to an edge: left out for its blur; compared beyond that
constexpr double CORE = 0.35;                       // of the width, to either side of the middle: shows the colour
constexpr double USUAL_QUANTILE = 0.35, USUAL_SQUARE = 0.2;  // quantile of squared normal numbers, and its value
constexpr double USUAL_PX = 10.0;                            // over which squares are averaged, to either side
// Bounds of a bisection over the bits of a square, which separates squares to some hundredths.
constexpr float LEAST_SQUARE = 0x1p-5f, MOST_SQUARE = 0x1p16f;
constexpr int SQUARE_ROUNDS = 10;

int steps(double px) { return static_cast<int>(std::rint(px / STRIP_STEP_PX)); }

// Sizes of a strip, in steps across and stations along.
struct Sizes {
    int stations, half, across;
    int gap, inner;           // of what is compared next to an edge
    int room, edges;          // first edge, and their number
    int wide, core, middles;  // from edge to middle; of what shows the colour; number of middles
    int far;                  // stations to either side over which the usual is averaged

    Sizes(ConstMatrix path, double width_px, double reach_px)
        : stations(path.shape[0]),
          half(static_cast<int>(std::ceil(reach_px / STRIP_STEP_PX))),
          across(2 * half + 1),
          gap(steps(EDGE_GAP_PX)),
          inner(steps(EDGE_GAP_PX + std::min(0.5 * width_px, EDGE_PX))),
          room(inner + 1),
          edges(across - 2 * room),
          wide(steps(0.5 * width_px)),
          core(steps(CORE * width_px)),
          middles(edges - 2 * wide) {
        const double along = stations > 1 ? arc_lengths(path)[stations - 1] / (stations - 1) : 0.0;
        const double step = std::max(along, 1e-6);
        far = static_cast<int>(std::min(std::max(USUAL_PX / step, 1.0), 1.0 * stations));
    }
};

using Samples = Array<float, 3>;  // (S, channels, across)

// Places of a station in a picture: the pixel before each, the fraction beyond it, and whether it is in the picture.
struct Across {
    std::vector<int> pixel;
    std::vector<float> right, down;

    explicit Across(int count) : pixel(count), right(count), down(count) {}
};

void lay_across(const Strip& strip, const Sizes& sizes, int station, std::array<int, 2> size, Across& across,
                unsigned char* __restrict inside) {
    const auto [height, width] = size;
    const float du = static_cast<float>(STRIP_STEP_PX * strip.normal(station, 0));
    const float dv = static_cast<float>(STRIP_STEP_PX * strip.normal(station, 1));
    const float first_u = static_cast<float>(strip.path(station, 0)) - static_cast<float>(sizes.half) * du;
    const float first_v = static_cast<float>(strip.path(station, 1)) - static_cast<float>(sizes.half) * dv;
    const float last_u = static_cast<float>(width - 1), last_v = static_cast<float>(height - 1);
    const int last_left = std::max(width - 2, 0), last_top = std::max(height - 2, 0);
    int* const __restrict pixel = across.pixel.data();
    float* const __restrict right = across.right.data(), * const __restrict down = across.down.data();
    for (int n = 0; n < sizes.across; ++n) {
        const float u = first_u + static_cast<float>(n) * du, v = first_v + static_cast<float>(n) * dv;
        const float x = std::min(std::max(0.0f, u), last_u), y = std::min(std::max(0.0f, v), last_v);
        const int left = std::min(static_cast<int>(x), last_left), top = std::min(static_cast<int>(y), last_top);
        pixel[n] = top * width + left;
        right[n] = x - static_cast<float>(left);
        down[n] = y - static_cast<float>(top);
        inside[n] = (x == u) & (y == v);
    }
}

// Levels of some channels, linear between pixels: into (channels, across).
template <int CHANNELS, class T>
void interpolate(const Levels<T>& levels, const Across& across, int count, float* __restrict to) {
    const auto [height, width, several] = levels.shape;
    const int right = width > 1 ? several : 0, below = height > 1 ? width * several : 0;
    for (int n = 0; n < count; ++n) {
        const T* const from = levels.data + static_cast<std::ptrdiff_t>(across.pixel[n]) * several;
        const float a = across.right[n], b = across.down[n];
        for (int k = 0; k < CHANNELS; ++k) {
            const float one = static_cast<float>(from[k]), other = static_cast<float>(from[below + k]);
            const float upper = one + a * (static_cast<float>(from[right + k]) - one);
            const float lower = other + a * (static_cast<float>(from[below + right + k]) - other);
            to[k * count + n] = upper + b * (lower - upper);
        }
    }
}

// Colours across each station, and which places (S, across) are within the picture.
template <class T>
void sample(const Colours<T>& picture, const Strip& strip, const Sizes& sizes, Samples& levels, Flags& inside) {
    const std::array<int, 2> size = {picture.levels.shape[0], picture.levels.shape[1]};
    const int count = sizes.across;
    Across across(count);
    for (int s = 0; s < sizes.stations; ++s) {
        lay_across(strip, sizes, s, size, across, inside.begin() + s * count);
        float* const to = levels.row(s).data;
        if (picture.channels() == 1)
            interpolate<1>(picture.levels, across, count, to);
        else
            interpolate<MOST_CHANNELS>(picture.levels, across, count, to);
        picture.convert(to, count, count);
    }
}

// Quantile of squares by bisection of their bits, which are ordered as the numbers are.
float quantile_of_squares(const float* squares, int count, double share) {
    const auto bits_of = [](float value) {
        std::int32_t bits;
        std::memcpy(&bits, &value, sizeof(bits));
        return bits;
    };
    std::int32_t low = bits_of(LEAST_SQUARE), high = bits_of(MOST_SQUARE);
    const int place = std::min(static_cast<int>(share * count), count - 1);
    float found = 0.0f;
    for (int round = 0; round < SQUARE_ROUNDS; ++round) {
        const std::int32_t middle = low + (high - low) / 2;
        std::memcpy(&found, &middle, sizeof(found));
        int below = 0;
        for (int i = 0; i < count; ++i) below += squares[i] < found;
        (below > place ? high : low) = middle;
    }
    return found;
}

// Differences (S, channels, edges) across each edge, and their variance (S, channels) where there is none.
void compare(const Samples& levels, const Sizes& sizes, Samples& apart, Table& usual) {
    const int edges = sizes.edges;
    const float share = 1.0f / static_cast<float>(sizes.inner - sizes.gap + 1);
    std::vector<float> squares(edges);
    for (int s = 0; s < sizes.stations; ++s)
        for (int k = 0; k < levels.shape[1]; ++k) {
            const float* const own = levels.row(s).row(k).data + sizes.room;
            float* const __restrict off = apart.row(s).row(k).data;
            for (int by = sizes.gap; by <= sizes.inner; ++by)
                for (int e = 0; e < edges; ++e) off[e] += own[e + by] - own[e - by];
            for (int e = 0; e < edges; ++e) off[e] *= share;
            for (int e = 0; e < edges; ++e) squares[e] = off[e] * off[e];
            usual(s, k) = quantile_of_squares(squares.data(), edges, USUAL_QUANTILE) / USUAL_SQUARE;
        }
}

// The log odds (edges,) of edges at a station.
void edges_at(int station, const Samples& apart, const Table& usual, const Sizes& sizes, const StripModel& model,
              float* __restrict edge) {
    const int channels = apart.shape[1];
    const int from = std::max(station - sizes.far, 0), to = std::min(station + sizes.far, sizes.stations - 1);
    std::fill_n(edge, sizes.edges, -1e9f);
    for (int k = 0; k < channels; ++k) {
        double sum = 0.0;
        for (int t = from; t <= to; ++t) sum += usual(t, k);
        const double variance =
            std::max({sum / (to - from + 1), square(model.noise[k]), static_cast<double>(LEAST_VARIANCE)});
        const auto [rise, low] = edge_scale(model.edges, variance);
        const float* const off = apart.row(station).row(k).data;
        for (int e = 0; e < sizes.edges; ++e) edge[e] = std::max(edge[e], off[e] * off[e] * rise - low);
    }
    const float several = static_cast<float>(std::log(channels));
    model.odds.replace(edge, sizes.edges, several);
}

// The antenna's usual colours at a share of its length.
UsualColours look_at(const Looks& looks, double part) {
    const double place = part * LOOK_PLACES - 0.5;
    const int p = std::min(std::max(static_cast<int>(std::floor(place)), 0), LOOK_PLACES - 2);
    const float share = static_cast<float>(bounded(place - p, 0.0, 1.0));
    UsualColours look;
    for (int k = 0; k < MOST_CHANNELS; ++k) {
        look.mean[k] = (1.0f - share) * looks[p].mean[k] + share * looks[p + 1].mean[k];
        look.variance[k] = (1.0f - share) * looks[p].variance[k] + share * looks[p + 1].variance[k];
    }
    return look;
}

// Adds the log odds of the colours between the edges.
void add_look(View<const float, 2> levels, const UsualColours& look, const Sizes& sizes, float most,
              float* __restrict odds) {
    const int channels = levels.shape[0], middles = sizes.middles;
    const LookOdds odds_of(look, channels);
    const float share = 1.0f / static_cast<float>(2 * sizes.core + 1);
    Array<float, 1> means(Unset{}, middles), sums(Unset{}, middles);
    float* const __restrict mean = means.begin(), * const __restrict sum = sums.begin();
    std::fill_n(sum, middles, odds_of.constant);
    for (int k = 0; k < channels; ++k) {
        const float* const own = levels.row(k).data + sizes.room + sizes.wide;
        std::fill_n(mean, middles, 0.0f);
        for (int by = -sizes.core; by <= sizes.core; ++by)
            for (int m = 0; m < middles; ++m) mean[m] += own[m + by];
        for (int m = 0; m < middles; ++m) sum[m] += odds_of(k, share * mean[m]);
    }
    for (int m = 0; m < middles; ++m) odds[m] += std::min(std::max(sum[m], -most), most);
}

// Log odds (middles,) of an antenna at a station, from the log odds of its edges.
void middles_at(int station, const float* edge, const Samples& levels, const Sizes& sizes, const StripModel& model,
                float* __restrict odds) {
    const float hidden = static_cast<float>(model.edges.hidden);
    const bool root = station < ROOT * sizes.stations;
    const float least = root ? static_cast<float>(model.edges.hidden_root) : hidden;
    const int middles = sizes.middles;
    for (int m = 0; m < middles; ++m) odds[m] = edge[m] + edge[m + 2 * sizes.wide];
    if (!model.looks) {
        for (int m = 0; m < middles; ++m) odds[m] = std::max(odds[m], least);
        return;
    }
    for (int m = 0; m < middles; ++m) odds[m] = std::max(odds[m], hidden);
    const UsualColours look = look_at(*model.looks, (station + 0.5) / sizes.stations);
    add_look(levels.row(station), look, sizes, static_cast<float>(model.edges.look), odds);
    for (int m = 0; m < middles; ++m) odds[m] = std::max(odds[m], 2.0f * least);
}

}  // namespace

template <class T>
Strip strip_along(const Colours<T>& picture, ConstMatrix path, double reach_px, const StripModel& model) {
    const Sizes sizes(path, model.width_px, reach_px);
    const int stations = sizes.stations, channels = picture.channels();
    Strip strip = {Table(path), normals(path), {}, STRIP_STEP_PX * (sizes.room + sizes.wide - sizes.half)};
    if (sizes.middles < 2) return strip;
    strip.odds = Array<float, 2>(stations, sizes.middles);
    Samples levels(stations, channels, sizes.across), apart(stations, channels, sizes.edges);
    Flags inside(stations * sizes.across);
    Table usual(stations, channels);
    sample(picture, strip, sizes, levels, inside);
    compare(levels, sizes, apart, usual);
    std::vector<float> edge(sizes.edges);
    const float beyond = static_cast<float>(0.5 * model.edges.hidden);
    for (int s = 0; s < stations; ++s) {
        edges_at(s, apart, usual, sizes, model, edge.data());
        float* const odds = strip.odds.row(s).data;
        middles_at(s, edge.data(), levels, sizes, model, odds);
        const unsigned char* const within = inside.begin() + s * sizes.across + sizes.room + sizes.wide;
        for (int m = 0; m < sizes.middles; ++m) odds[m] = within[m] ? odds[m] : beyond;
    }
    return strip;
}

template Strip strip_along(const Colours<std::uint8_t>&, ConstMatrix, double, const StripModel&);
template Strip strip_along(const Colours<std::uint16_t>&, ConstMatrix, double, const StripModel&);
template Strip strip_along(const Colours<float>&, ConstMatrix, double, const StripModel&);
template Strip strip_along(const Colours<double>&, ConstMatrix, double, const StripModel&);

}  // namespace vbaa::detect
