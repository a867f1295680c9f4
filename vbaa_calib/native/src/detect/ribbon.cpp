// The ribbon's normal equations, eight profiles at once, and their solution.
#include "detect/ribbon.hpp"

#include <array>
#include <cmath>

#include "lanes.hpp"
#include "smooth.hpp"

namespace vbaa::detect {
namespace {

// Unknowns of a profile alone: levels of both sides, slope, own brightness; then those of the line, and the grey level.
constexpr int ALONE = 4, OWN = 3, FIRST = ALONE, PLACE = FIRST + SHADES, WIDER = PLACE + 1, SOFTER = PLACE + 2;
constexpr int TAPER = PLACE + 3, LEVEL = PLACE + 4, COLUMNS = LEVEL + 1;
constexpr int SHARED = COLUMNS - ALONE;  // columns that are left when a profile's own unknowns are eliminated
constexpr int AT_PLACE = PLACE - ALONE, AT_LEVEL = LEVEL - ALONE, CHANGES = 3;  // width, blur, taper
constexpr double PIECE_PX = 60.0;                                               // of the course
constexpr int LEAST_PIECES = 4, MOST_PIECES = 12, LEAST_KNOTS = 6, MOST_KNOTS = 41;
constexpr int SOME = 100;            // profiles that are enough until the last round
constexpr double KNOWN = 0.2;        // weight of the prior of a size, in profiles
constexpr int GIVEN = 2;             // rounds with the initial priors of the shades
constexpr double FREED = 6.0;        // unknowns of a profile
constexpr double LEAST_NOISE = 0.3;  // grey levels: their rounding
constexpr double DISTURBED = 3.0;    // times the noise at which a profile counts half
// MISFIT: log odds that a profile loses for each unit by which the squared residuals within the ribbon, over the
// noise's, exceed ALLOWED.
constexpr double MISFIT = 0.2, ALLOWED = 6.0;
constexpr double UNLIKE = 0.12;     // part of its light that the shades do not describe
constexpr double MOST_ODDS = 2.5;   // of a profile, either way
constexpr int FAR_PX = 64;          // distances from its edge at which the background's own structure is known
constexpr int EDGES = 3;            // that are tried in its place
constexpr int PATTERN = 32;         // distances from its centre at which residuals are compared along it
constexpr double PULLING_PX = 2.0;  // beyond its edge, within which those residuals displace it
constexpr double FAINTEST = 0.15;   // of the strongest channel's contrast
constexpr double FINEST = 20.0;     // px that a bend's standard deviation refers to

using Unknowns = std::array<Lanes, COLUMNS*(COLUMNS + 1) / 2>;
constexpr int at(int i, int j) { return i * (i + 1) / 2 + j; }  // j ≤ i

// A profile's equations in one channel without its own unknowns, in whole lanes: the shades by each other, by the
// place, by each of the others (width, blur, taper and level), the place by itself and these, the others by each other.
struct Reduced {
    static constexpr int OTHERS = COLUMNS - PLACE - 1, PAIRS = whole_lanes(SHADES * (SHADES + 1) / 2);
    static constexpr int BY_PLACE = PAIRS, BY_OTHERS = BY_PLACE + LANES, PLACE_BY = BY_OTHERS + OTHERS * LANES;
    static constexpr int OTHERS_BY = PLACE_BY + LANES, SIZE = OTHERS_BY + whole_lanes(OTHERS * (OTHERS + 1) / 2);

    std::array<double, SIZE> left;
    std::array<double, whole_lanes(ALONE* SHARED)>
        alone;                           // own unknowns: by level, less so much of every other unknown
    std::array<double, LANES> variance;  // of the step between the sides, slope, own brightness

    static constexpr int at_pair(int i, int j) {  // j ≤ i
        if (i < AT_PLACE) return at(i, j);
        if (j < AT_PLACE) return i == AT_PLACE ? BY_PLACE + j : BY_OTHERS + (i - AT_PLACE - 1) * LANES + j;
        return j == AT_PLACE ? PLACE_BY + i - AT_PLACE : OTHERS_BY + at(i - AT_PLACE - 1, j - AT_PLACE - 1);
    }
    double operator()(int i, int j) const { return left[at_pair(i, j)]; }
};

// The pixels of eight profiles, stored until they are added up.
struct Pixels {
    std::vector<Lanes> columns;                            // (T, COLUMNS) times the root of a pixel's weight
    std::vector<Lanes> level, across, far, sure, counted;  // (T,)
    std::vector<int> row, bin;  // (T, LANES) of the table of shades, of the background's structure

    void resize(int length) {
        columns.resize(length * COLUMNS);
        for (auto* each : {&level, &across, &far, &sure, &counted}) each->resize(length);
        for (auto* each : {&row, &bin}) each->resize(length * LANES);
    }
};

// Estimates of one channel in the present round.
struct Channel {
    const Crossings* found;
    double contrast, noise, step, own, slope;
    std::array<double, SHADES> spread;         // prior deviations of the shades
    std::array<double, FAR_PX> per_structure;  // the noise's variance over that by distance from the edge
    std::array<double, FAR_PX> power, number;  // sums of squares from which that is learnt
    std::array<double, PATTERN> left, many;    // sums of residuals by distance from the centre, and of how many
    Table alone, shades;                       // (N, ALONE) and (N, SHADES)
    std::vector<Reduced> equations;
    Numbers rms, inner;                // residuals, everywhere and where the ribbon is
    std::array<Numbers, EDGES> edges;  // log odds against an edge alone: on the right, on the left, between
};

struct Line {
    const RibbonPriors& model;
    double width_px, blur_px;
    std::vector<Channel> channels;
    Numbers share;
    Numbers course;  // (N,) across the path, px
    Numbers seen, weight;
    std::array<double, CHANGES> moved = {};
    // knots of the shades, and pieces of the course
    int knots, pieces;
    std::vector<int> knot, piece;
    Pixels pixels;
    Numbers after;               // (N,) part of the way from a knot to the next
    Table basis;                 // (N, 4) of the course's splines
    std::vector<double> offset;  // (pieces + 3) of the course
    Table variance;              // of the border's unknowns
    Table course_information;    // of the course, with all else known
    Table table;                 // of its shades, for its width and blur

    int count() const { return share.size(); }
    double length_px() const { return channels[0].found->along[count() - 1] - channels[0].found->along[0]; }
    int border() const { return pieces + 3 + CHANGES; }
    double width() const { return width_px * std::exp(moved[0]); }
    double blur() const { return blur_px * std::exp(moved[1]); }
    double scale(int n) const { return 1.0 + moved[2] * (share[n] - 0.5); }
};

double prior_of_shade(const RibbonPriors& model, int k) {
    const int order = (k + 1) / 2;
    return k == 0 ? 3.0 : model.shades * 1.2 / (1.0 + order);
}

Line begun(const std::vector<Crossings>& channels, double width_px, double blur_px, const RibbonPriors& model) {
    Line line = {model, width_px, blur_px, {}, {}, {}, {}, {}, {}, 0, 0, {}, {}, {}, {}, {}, {}, {}, {}, {}};
    const Crossings& first = channels[0];
    const int count = first.along.size();
    double most = 0.0;
    for (const Crossings& found : channels) {
        Channel channel = {};
        channel.found = &found;
        std::vector<double> powers;
        const int length = found.profiles.shape[1];
        for (int n = 0; n < count; ++n) {
            if (!found.inside[n]) continue;
            double sum = 0.0, squares = 0.0;
            for (int t = 0; t < length; ++t) sum += found.profiles(n, t), squares += square(found.profiles(n, t));
            powers.push_back(squares / length - square(sum / length));
        }
        const int known = static_cast<int>(powers.size());
        channel.contrast = known ? std::sqrt(std::max(quantile({powers.data(), {known}}, 0.7), 0.0)) + 1e-6 : 1.0;
        most = std::max(most, channel.contrast);
        line.channels.push_back(std::move(channel));
    }
    for (Channel& channel : line.channels) {
        channel.contrast = std::max(channel.contrast, FAINTEST * most);
        channel.noise = std::max(0.3 * channel.contrast, 1e-3);
        channel.step = 2.0 * channel.contrast;
        channel.own = 0.5 * channel.contrast;
        channel.slope = 2.0 * channel.contrast / channel.found->profiles.shape[1];
        channel.per_structure.fill(1.0);
        for (int k = 0; k < SHADES; ++k) channel.spread[k] = prior_of_shade(model, k) * channel.contrast;
        channel.alone = Table(count, ALONE);
        channel.shades = Table(count, SHADES);
        channel.equations.resize(count);
        channel.rms = channel.inner = Numbers(count);
        channel.edges.fill(Numbers(count));
    }
    const double length = std::max(first.along[count - 1] - first.along[0], 1e-6);
    line.share = each(count, [&](int n) { return (first.along[n] - first.along[0]) / length; });
    line.course = Numbers(count);
    line.seen = each(count, [&](int n) { return first.inside[n] ? 1.0 : 0.0; });
    line.weight = line.seen;
    line.knots = static_cast<int>(bounded(std::rint(length / model.knot_px) + 1, LEAST_KNOTS, MOST_KNOTS));
    line.pieces = static_cast<int>(bounded(std::rint(length / PIECE_PX), LEAST_PIECES, MOST_PIECES));
    line.after = Numbers(count);
    line.basis = Table(count, 4);
    line.offset.assign(line.pieces + 3, 0.0);
    for (int n = 0; n < count; ++n) {
        const double place = line.share[n] * (line.knots - 1);
        line.knot.push_back(std::min(static_cast<int>(place), line.knots - 2));
        line.after[n] = place - line.knot[n];
        const double along = line.share[n] * line.pieces;
        line.piece.push_back(std::min(static_cast<int>(along), line.pieces - 1));
        const double u = along - line.piece[n], v = 1.0 - u;
        line.basis(n, 0) = v * v * v / 6.0;
        line.basis(n, 1) = (4.0 - 6.0 * u * u + 3.0 * u * u * u) / 6.0;
        line.basis(n, 2) = (4.0 - 6.0 * v * v + 3.0 * v * v * v) / 6.0;
        line.basis(n, 3) = u * u * u / 6.0;
    }
    return line;
}

// The part of the squared right side (last row) that a system of lanes (lower half) explains.
template <int COUNT>
Lanes explained(std::array<Lanes, (COUNT + 1) * (COUNT + 2) / 2>& m) {
    Lanes total = 0.0;
#pragma GCC unroll 8
    for (int k = 0; k < COUNT; ++k) {
        const Lanes pivot = Lanes(1.0) / m[at(k, k)];
#pragma GCC unroll 8
        for (int i = k + 1; i <= COUNT; ++i) {
            const Lanes factor = m[at(i, k)] * pivot;
#pragma GCC unroll 8
            for (int j = k + 1; j <= i; ++j) m[at(i, j)] -= factor * m[at(j, k)];
        }
        total += m[at(COUNT, k)] * m[at(COUNT, k)] * pivot;
    }
    return total;
}

// Up to eight profiles of a channel, and where they are; those that are missing weigh nothing.
struct Eight {
    int several;
    std::array<int, LANES> which;
    std::array<const double*, LANES> grey;
    Lanes shift, side, per_stretch, bow, per_scale, there, share, slope, mean;
    std::array<Lanes, FUNCTIONS> coefficients;  // of each function, above its mean
    std::array<Lanes, LANES> own;               // the same, of each profile
    std::array<bool, LANES> clear;              // whether it is seen there, undisturbed
};

Eight gathered_profiles(const Line& line, const Channel& channel, const int* which, int several) {
    const Crossings& found = *channel.found;
    Eight eight = {};
    eight.several = several;
    for (int lane = 0; lane < LANES; ++lane) {
        const int n = eight.which[lane] = which[std::min(lane, several - 1)];
        eight.grey[lane] = found.profiles.row(n).data;
        eight.shift[lane] = line.course[n] * found.side[n] * found.stretch[n] - found.across(n, 0);
        // a profile that crosses the line at a slant meets one edge where it is broader
        const double growth = line.moved[2] / (std::max(line.length_px(), 1.0) * line.scale(n));
        const double wider = std::abs(growth) < 1.0 ? growth * found.slant[n] / found.stretch[n] : 0.0;
        eight.side[lane] = found.side[n], eight.bow[lane] = found.bow[n] - wider;
        eight.per_stretch[lane] = 1.0 / found.stretch[n], eight.per_scale[lane] = 1.0 / line.scale(n);
        eight.there[lane] = lane < several && found.inside[n] ? 1.0 : 0.0;
        eight.share[lane] = line.share[n] - 0.5, eight.slope[lane] = channel.alone(n, 2);
        const double mean = channel.shades(n, 0) + channel.alone(n, OWN);
        double own[LANES] = {channel.alone(n, 0) - mean, channel.alone(n, 1) - mean};
        for (int k = 1; k < SHADES; ++k) own[shade_column(k)] = channel.shades(n, k);
        eight.mean[lane] = mean;
        for (int f = 0; f < FUNCTIONS; ++f) eight.coefficients[f][lane] = own[f];
        eight.own[lane] = load(own);
        eight.clear[lane] = found.inside[n] && channel.rms[n] < 2.5 * channel.noise && line.seen[n] > 0.5;
    }
    return eight;
}

// Sums over the pixels of eight profiles.
struct Sums {
    Unknowns products;
    Lanes squares = 0.0, inner = 0.0, number = 0.0, left = 0.0;  // of residuals
};

// Adds up the products of two groups of columns (T, COLUMNS), which stay in the processor's registers meanwhile.
template <int TILE, int FROM, int OTHER>
void add_products(const std::vector<Lanes>& columns, Unknowns& products) {
    std::array<Lanes, TILE * TILE> sums = {};
    for (std::size_t t = 0; t < columns.size(); t += COLUMNS) {
        const Lanes *const one = &columns[t + FROM], *const other = &columns[t + OTHER];
#pragma GCC unroll 8
        for (int i = 0; i < TILE; ++i)
#pragma GCC unroll 8
            for (int j = 0; j < TILE; ++j)
                if (FROM + i >= OTHER + j) sums[i * TILE + j] += one[i] * other[j];
    }
    for (int i = 0; i < TILE; ++i)
        for (int j = 0; j < TILE; ++j)
            if (FROM + i >= OTHER + j) products[at(FROM + i, OTHER + j)] = sums[i * TILE + j];
}

// Adds up the products of all columns, in square groups.
template <int TILE, int... PAIR>
void add_all_products(const std::vector<Lanes>& columns, Unknowns& products, std::integer_sequence<int, PAIR...>) {
    static_assert(COLUMNS % TILE == 0);
    constexpr int several = COLUMNS / TILE;
    const auto add = [&](auto pair) {
        constexpr int from = pair / several, other = pair % several;
        if constexpr (other <= from) add_products<TILE, from * TILE, other * TILE>(columns, products);
    };
    (add(std::integral_constant<int, PAIR>()), ...);
}

// Locates the pixels of eight profiles: distance from the line's middle, row in the table of shades, bin of the
// background.
void place_pixels(const Channel& channel, const Table& table, const Eight& eight, double half, Pixels& pixels) {
    const int length = channel.found->profiles.shape[1], last = table.shape[0] - 1;
    const auto clamped = [](const Lanes& value, const Lanes& most) {
        return where_positive(value - most, most, where_positive(value, value, 0.0));
    };
    pixels.resize(length);
    for (int lane = 0; lane < LANES; ++lane)
        for (int t = 0; t < length; ++t) pixels.level[t][lane] = eight.grey[lane][t];
    for (int t = 0; t < length; ++t) {
        const Lanes along = Lanes(t) - eight.shift;
        const Lanes across = eight.side * along * (eight.per_stretch + eight.bow * along) * eight.per_scale;
        const Lanes place = clamped(across * Lanes(PER_PX) + Lanes(0.5 * last), last - 1e-9);
        pixels.across[t] = across;
        pixels.far[t] = place - truncated(place, &pixels.row[t * LANES]);
        truncated(clamped(absolute(across) - Lanes(half), FAR_PX - 1.0), &pixels.bin[t * LANES]);
    }
    for (int t = 0; t < length; ++t)
        for (int lane = 0; lane < LANES; ++lane)
            pixels.sure[t][lane] = channel.per_structure[pixels.bin[t * LANES + lane]];
}

Sums over_pixels(const Line& line, Channel& channel, const Table& table, const Eight& eight, bool first,
                 Pixels& pixels) {
    const int length = channel.found->profiles.shape[1];
    const double half = 0.5 * line.width(), per_bin = static_cast<double>(PATTERN) / length;
    const double noise = square(channel.noise), cut = 1.0 / (square(line.model.cut) * noise);
    place_pixels(channel, table, eight, half, pixels);
    Sums sums;
    Lanes functions[LANES], derivatives[KINDS][LANES];
    for (int t = 0; t < length; ++t) {
        Lanes* const columns = &pixels.columns[t * COLUMNS];
        const Lanes across = pixels.across[t], level = pixels.level[t], sure = pixels.sure[t];
        for (int lane = 0; lane < LANES; ++lane) {
            const double* const row = table.row(pixels.row[t * LANES + lane]).data;
            const Lanes part = spread(pixels.far[t][lane]);
            const auto between = [&](int kind) {
                const Lanes one = load(row + kind * LANES);
                return one + part * (load(row + SHADE_COLUMNS + kind * LANES) - one);
            };
            functions[lane] = between(VALUE);
            for (int kind = 1; kind < KINDS; ++kind) derivatives[kind][lane] = eight.own[lane] * between(kind);
        }
        transpose(functions);
        Lanes weight = eight.there * sure * Lanes(1.0 / noise);
        if (!first) {
            Lanes residual = level - eight.mean - eight.slope * across;
            for (int f = 0; f < FUNCTIONS; ++f) residual -= eight.coefficients[f] * functions[f];
            const Lanes power = residual * residual;
            const Lanes counted = Lanes(1.0) / (Lanes(1.0) + power * sure * Lanes(cut));
            const Lanes within = choose(absolute(across) < Lanes(half + 1.0), Lanes(1.0), Lanes(0.0));
            weight *= counted;
            sums.squares += eight.there * power;
            sums.inner += within * power;
            sums.number += within;
            sums.left += weight * power;
            // overwritten: their first use is over
            pixels.far[t] = residual, pixels.counted[t] = counted;
        }
        const Lanes root = sqrt(weight);
        for (int side = 0; side < SIDES; ++side) columns[side] = root * functions[side];
        columns[2] = root * across;
        columns[OWN] = columns[FIRST] = root - columns[0] - columns[1];
        for (int k = 1; k < SHADES; ++k) columns[FIRST + k] = root * functions[shade_column(k)];
        columns[PLACE] = -root * sums_of(derivatives[BY_DISTANCE]) * eight.per_scale;
        columns[WIDER] = root * sums_of(derivatives[BY_WIDTH]);
        columns[SOFTER] = root * sums_of(derivatives[BY_BLUR]);
        columns[TAPER] = columns[WIDER] * eight.share;
        columns[LEVEL] = root * level;
    }
    for (int lane = 0; lane < eight.several && !first; ++lane) {
        if (!eight.clear[lane]) continue;
        for (int t = 0; t < length; ++t) {
            const double residual = pixels.far[t][lane], counted = pixels.counted[t][lane];
            const int bin = pixels.bin[t * LANES + lane];
            channel.power[bin] += counted * square(residual);
            channel.number[bin] += counted;
            const double of_width = pixels.across[t][lane] * per_bin + 0.5 * PATTERN;
            const int place = static_cast<int>(bounded(of_width, 0.0, PATTERN - 1.0));
            channel.left[place] += residual, channel.many[place] += 1.0;
        }
    }
    constexpr int tile = 4, several = COLUMNS / tile;
    add_all_products<tile>(pixels.columns, sums.products, std::make_integer_sequence<int, several * several>());
    return sums;
}

// What an edge alone explains of eight profiles: levels of both sides and slope; where it is between them, two
// antisymmetric shades, and by how much the ribbon's own level is off the middle. `left` and `right` are the parts of
// both sides' levels in its own one, `per_apart` one over the squares of how much the sides differ.
template <int COUNT>
Lanes explained_by_edge(const Unknowns& products, double left, double right, const Lanes& per_apart) {
    constexpr double per_off_middle = 16.0;  // the edge may be off it by a quarter of how much the sides differ
    constexpr int columns[] = {0, 1, 2, FIRST + 1, FIRST + 3, OWN, LEVEL};
    const double part[] = {left, right};
    std::array<Lanes, (COUNT + 1) * (COUNT + 2) / 2> system;
#pragma GCC unroll 8
    for (int i = 0; i <= COUNT; ++i) {
        const int column = i == COUNT ? LEVEL : columns[i];
#pragma GCC unroll 8
        for (int j = 0; j <= i; ++j) {
            const int other = j == COUNT ? LEVEL : columns[j];
            const auto product = [&](int a, int b) { return products[a > b ? at(a, b) : at(b, a)]; };
            Lanes value = product(column, other);
            if (i < 2) value += Lanes(part[i]) * product(OWN, other);
            if (j < 2) value += Lanes(part[j]) * product(column, OWN);
            if (i < 2 && j < 2) value += Lanes(part[i] * part[j]) * product(OWN, OWN);
            if (i == j && i > 2 && i < COUNT) value += i == 5 ? Lanes(per_off_middle) * per_apart : per_apart;
            system[at(i, j)] = value;
        }
    }
    return explained<COUNT>(system);
}

// Log odds of the ribbon against one edge alone: the ribbon's place is as bright as the left side, or as the right one,
// or the edge lies between with one brightness on either side.
void compare_with_edges(Channel& channel, const Eight& eight, const Sums& sums) {
    const Lanes apart = eight.coefficients[1] - eight.coefficients[0];
    const Lanes per_apart = Lanes(1.0) / (Lanes(square(channel.noise)) + apart * apart);
    const std::array<Lanes, EDGES> explained = {explained_by_edge<3>(sums.products, 1.0, 0.0, per_apart),
                                                explained_by_edge<3>(sums.products, 0.0, 1.0, per_apart),
                                                explained_by_edge<6>(sums.products, 0.5, 0.5, per_apart)};
    for (int edge = 0; edge < EDGES; ++edge) {
        const Lanes instead = sums.products[at(LEVEL, LEVEL)] - sums.left - explained[edge];
        for (int lane = 0; lane < eight.several; ++lane) channel.edges[edge][eight.which[lane]] = instead[lane];
    }
}

// The equations of up to eight profiles in one channel, without their own unknowns.
void evaluate(Line& line, Channel& channel, const int* which, int several, bool first) {
    const int length = channel.found->profiles.shape[1];
    const Eight eight = gathered_profiles(line, channel, which, several);
    Sums found = over_pixels(line, channel, line.table, eight, first, line.pixels);
    Unknowns& sums = found.products;
    const double step = 1.0 / square(channel.step), loose = 1e-6 / square(channel.contrast);
    sums[at(0, 0)] += step + loose, sums[at(1, 1)] += step + loose, sums[at(1, 0)] -= step;
    sums[at(2, 2)] += 1.0 / square(channel.slope);
    if (!first) {
        compare_with_edges(channel, eight, found);
        for (int lane = 0; lane < several; ++lane) {
            channel.rms[which[lane]] = std::sqrt(found.squares[lane] / std::max(length - FREED, 3.0));
            channel.inner[which[lane]] = std::sqrt(found.inner[lane] / std::max<double>(found.number[lane], 1.0));
        }
    }
    sums[at(OWN, OWN)] += 1.0 / square(channel.own);
    // eliminate a profile's own unknowns, the last one first of all that are solved for
    std::array<Lanes, ALONE> per_pivot;
    std::array<std::array<Lanes, COLUMNS>, ALONE> factor;
    for (int k = 0; k < ALONE; ++k) {
        per_pivot[k] = Lanes(1.0) / sums[at(k, k)];
        for (int i = k + 1; i < COLUMNS; ++i) {
            factor[k][i] = sums[at(i, k)] * per_pivot[k];
            for (int j = k + 1; j <= i; ++j) sums[at(i, j)] -= factor[k][i] * sums[at(j, k)];
        }
    }
    // own unknowns by the others: back substitution of L D Lᵀ
    std::array<Lanes, whole_lanes(ALONE * SHARED)> alone;
    for (int s = 0; s < SHARED; ++s)
        for (int k = ALONE - 1; k >= 0; --k) {
            Lanes value = factor[k][ALONE + s];
            for (int i = k + 1; i < ALONE; ++i) value -= factor[k][i] * alone[i * SHARED + s];
            alone[k * SHARED + s] = value;
        }
    const auto variance_of = [&](std::array<Lanes, ALONE> row) {
        Lanes value = 0.0;
        for (int k = 0; k < ALONE; ++k) {
            for (int i = k + 1; i < ALONE; ++i) row[i] -= factor[k][i] * row[k];
            value += row[k] * row[k] * per_pivot[k];
        }
        return value;
    };
    const std::array<Lanes, LANES> variance = {variance_of({-1.0, 1.0, 0.0, 0.0}), variance_of({0.0, 0.0, 1.0, 0.0}),
                                               variance_of({0.0, 0.0, 0.0, 1.0})};
    std::array<Lanes, Reduced::SIZE> left;
    for (int i = 0; i < SHARED; ++i)
        for (int j = 0; j <= i; ++j) left[Reduced::at_pair(i, j)] = sums[at(ALONE + i, ALONE + j)];
    const auto write = [&](const auto& columns, auto part) {
        for (std::size_t from = 0; from < columns.size(); from += LANES) {
            Lanes rows[LANES];
            std::copy_n(&columns[from], LANES, rows);
            transpose(rows);
            for (int lane = 0; lane < several; ++lane)
                store((channel.equations[which[lane]].*part).data() + from, rows[lane]);
        }
    };
    write(left, &Reduced::left), write(alone, &Reduced::alone), write(variance, &Reduced::variance);
}

// Probabilities (M,) of being seen, from log odds (M,), by a two-state Markov chain with this rate of change.
Numbers chain(const Numbers& odds, double rate) {
    const int count = odds.size();
    Numbers before(count), probability(count);
    double hidden = 0.5;
    for (int n = 0; n < count; ++n) {
        const double to_hidden = hidden * (1.0 - rate) + (1.0 - hidden) * rate;
        const double seen = (1.0 - to_hidden) * std::exp(odds[n]);
        hidden = to_hidden / (to_hidden + seen);
        before[n] = hidden;
    }
    double one = 0.5, other = 0.5;  // likelihood of the profiles after this one, if hidden and if seen here
    for (int n = count - 1; n >= 0; --n) {
        const double away = before[n] * one, here = (1.0 - before[n]) * other;
        probability[n] = here / (away + here);
        const double was = one, now = other * std::exp(odds[n]);
        // the profile's own evidence counts for those before it
        const double unseen = was;
        one = (1.0 - rate) * unseen + rate * now;
        other = rate * unseen + (1.0 - rate) * now;
        const double whole = one + other;
        one /= whole, other /= whole;
    }
    return probability;
}

// Power of what the ribbon shows above its background.
double shown_power(const Channel& channel, int n) {
    double power = square(channel.shades(n, 0) - 0.5 * (channel.alone(n, 0) + channel.alone(n, 1)));
    for (int k = 1; k < SHADES; ++k) power += square(channel.shades(n, k));
    return power;
}

// Expected rms residual of a profile: noise, and the part of its light that the shades do not describe.
double expected_rms(const Channel& channel, int n) {
    return std::sqrt(square(channel.noise) + square(UNLIKE) * shown_power(channel, n));
}

// Decides which profiles show the ribbon, and how much each counts.
void weigh(Line& line, const std::vector<int>& active, int step) {
    const int count = static_cast<int>(active.size());
    for (Channel& channel : line.channels) {
        const Numbers known = each(count, [&](int m) { return channel.rms[active[m]]; });
        const Flags inside = each(count, [&](int m) { return channel.found->inside[active[m]] != 0; });
        channel.noise = std::max({quantile(selected(known, inside), QUIET), 1e-3 * channel.contrast, LEAST_NOISE});
    }
    const double part = 0.5 * std::min(1.0, line.model.alike * step);
    const Numbers odds = each(count, [&](int m) {
        const int n = active[m];
        if (!line.channels[0].found->inside[n]) return 0.0;
        std::array<double, EDGES> edges = {};
        double misfit = 0.0;
        for (const Channel& channel : line.channels) {
            for (int edge = 0; edge < EDGES; ++edge) edges[edge] += channel.edges[edge][n];
            misfit += square(channel.inner[n] / expected_rms(channel, n));
        }
        misfit /= static_cast<double>(line.channels.size());
        const double least = part * *std::min_element(edges.begin(), edges.end());
        return bounded(bounded(least, -MOST_ODDS, MOST_ODDS) - MISFIT * std::max(misfit - ALLOWED, 0.0), -MOST_ODDS,
                       MOST_ODDS);
    });
    const Numbers seen = chain(odds, 1.0 - std::pow(1.0 - 1.0 / line.model.change_px, step));
    for (int m = 0; m < count; ++m) {
        const int n = active[m];
        double power = 0.0;
        for (const Channel& channel : line.channels) power += square(channel.rms[n] / expected_rms(channel, n));
        power /= static_cast<double>(line.channels.size());
        line.seen[n] = seen[m];
        line.weight[n] = line.channels[0].found->inside[n] ? seen[m] / square(1.0 + power / square(DISTURBED)) : 0.0;
    }
}

// Unknowns of the border, and the right side, in whole lanes.
constexpr int MOST_ROWS = whole_lanes(MOST_PIECES + 3 + CHANGES + 1), ROW_LANES = MOST_ROWS / LANES;
using Block = std::array<double, SHADES * LANES>;        // of one knot's shades by another's
using Hanging = std::array<double, SHADES * MOST_ROWS>;  // of one knot's shades by the border's unknowns
using Border = std::array<double, MOST_ROWS * MOST_ROWS>;

// A channel's equations at one of its knots: by its own shades, by those of the next knot, and by the border; after
// elimination also its shades as functions of those of the next knot and of the border.
struct Knot {
    Block own, next;
    Hanging border;
    Block towards_next, inverse;
    Hanging towards_border;
};

// Adds a multiple of a row of so many lanes.
template <int COUNT>
void add(double* to, double factor, const double* row) {
    for (int i = 0; i < COUNT * LANES; i += LANES) store(to + i, load(to + i) + Lanes(factor) * load(row + i));
}

// Summed equations of the profiles between two knots, on one piece of the course.
struct Stretch {
    static constexpr int OTHERS = Reduced::OTHERS;
    std::array<Lanes, Reduced::PAIRS / LANES> own = {}, next = {},
                                              other = {};  // of the shades at the first knot, both, the second
    std::array<Lanes, 2 * 4> by_place = {};                // at each knot by each spline
    std::array<Lanes, 2 * OTHERS> by_others = {};
    std::array<Lanes, 4> place_by = {};
    std::array<double, 4 * 4> places = {};
    std::array<Lanes, (Reduced::SIZE - Reduced::OTHERS_BY) / LANES> others = {};

    void add(const double* left, double weight, double after, const double* basis) {
        const double before = 1.0 - after, parts[2] = {weight * before, weight * after};
        for (std::size_t i = 0; i < own.size(); ++i) {
            const Lanes pairs = load(left + i * LANES);
            own[i] += Lanes(parts[0] * before) * pairs;
            next[i] += Lanes(parts[0] * after) * pairs;
            other[i] += Lanes(parts[1] * after) * pairs;
        }
        const Lanes of_place = load(left + Reduced::BY_PLACE), own_place = load(left + Reduced::PLACE_BY);
        for (int b = 0; b < 4; ++b) {
            for (int p = 0; p < 2; ++p) by_place[p * 4 + b] += Lanes(parts[p] * basis[b]) * of_place;
            place_by[b] += Lanes(weight * basis[b]) * own_place;
            for (int c = 0; c < 4; ++c) places[b * 4 + c] += weight * left[Reduced::PLACE_BY] * basis[b] * basis[c];
        }
        for (int s = 0; s < OTHERS; ++s)
            for (int p = 0; p < 2; ++p)
                by_others[p * OTHERS + s] += Lanes(parts[p]) * load(left + Reduced::BY_OTHERS + s * LANES);
        for (std::size_t i = 0; i < others.size(); ++i)
            others[i] += Lanes(weight) * load(left + Reduced::OTHERS_BY + i * LANES);
    }
    // Adds it to the equations of its knots and of the border, in which its splines begin at `piece`, the unknowns that
    // apply all along at `splines`, and the right side at `rows`.
    void put(Knot* pair, int piece, int splines, int rows, Border& border) const {
        const auto of = [](const auto& lanes, int i) { return lanes[i / LANES][i % LANES]; };
        for (int i = 0; i < SHADES; ++i)
            for (int j = 0; j <= i; ++j) {
                pair[0].own[i * LANES + j] += of(own, at(i, j));
                pair[0].next[i * LANES + j] += of(next, at(i, j));
                pair[1].own[i * LANES + j] += of(other, at(i, j));
            }
        for (int p = 0; p < 2; ++p)
            for (int k = 0; k < SHADES; ++k) {
                double* const row = &pair[p].border[k * MOST_ROWS];
                for (int b = 0; b < 4; ++b) row[piece + b] += by_place[p * 4 + b][k];
                for (int s = 0; s < CHANGES; ++s) row[splines + s] += by_others[p * OTHERS + s][k];
                row[rows] += by_others[p * OTHERS + CHANGES][k];
            }
        for (int b = 0; b < 4; ++b) {
            double* const row = &border[(piece + b) * MOST_ROWS];
            for (int c = 0; c < 4; ++c) row[piece + c] += places[b * 4 + c];
            for (int s = 0; s < CHANGES; ++s) {
                row[splines + s] += place_by[b][1 + s];
                border[(splines + s) * MOST_ROWS + piece + b] += place_by[b][1 + s];
            }
            row[rows] += place_by[b][OTHERS];
        }
        for (int s = 0; s < CHANGES; ++s) {
            for (int r = 0; r < CHANGES; ++r)
                border[(splines + s) * MOST_ROWS + splines + r] += of(others, at(std::max(s, r), std::min(s, r)));
            border[(splines + s) * MOST_ROWS + rows] += of(others, at(CHANGES, s));
        }
    }
};

// Sums the profiles of a channel into the equations of its knots and of the border.
std::vector<Knot> gathered(const Line& line, const Channel& channel, const std::vector<int>& active, double per_profile,
                           Border& border) {
    std::vector<Knot> knots(line.knots, Knot{});
    const auto together = [&](int n) { return std::pair(line.knot[n], line.piece[n]); };
    for (auto n = active.begin(); n != active.end();) {
        const auto [knot, piece] = together(*n);
        Stretch stretch;
        for (; n != active.end() && together(*n) == std::pair(knot, piece); ++n) {
            const double weight = line.weight[*n] * per_profile;
            if (!(weight > 1e-4)) continue;
            stretch.add(channel.equations[*n].left.data(), weight, line.after[*n], line.basis.row(*n).data);
        }
        stretch.put(&knots[knot], piece, line.pieces + 3, line.border(), border);
    }
    for (Knot& knot : knots)
        for (int i = 0; i < SHADES; ++i)
            for (int j = 0; j < i; ++j) {
                knot.own[j * LANES + i] = knot.own[i * LANES + j];
                knot.next[j * LANES + i] = knot.next[i * LANES + j];
            }
    return knots;
}

// Priors of a channel's shades: how large they are, and how much they change from knot to knot.
void add_priors(const std::array<double, SHADES>& spread, double contrast, std::vector<Knot>& knots) {
    for (int k = 0; k < SHADES; ++k) {
        const double change = 1.0 / square(k ? 0.5 * spread[k] : 0.7 * contrast);
        const double size = k ? 1.0 / square(spread[k]) : 1e-6 / square(contrast);
        for (Knot& knot : knots) knot.own[k * LANES + k] += size + 2.0 * change, knot.next[k * LANES + k] -= change;
        knots.front().own[k * LANES + k] -= change, knots.back().own[k * LANES + k] -= change;
    }
}

// Eliminates a knot: its shades as functions of the next knot's and of the border's unknowns, and the inverse of its
// own equations.
void solve(Knot& knot, bool with_next) {
    constexpr int next = 0, border = LANES, unit = LANES + MOST_ROWS, count = unit / LANES + 1, wide = count * LANES;
    Block matrix = knot.own;
    std::array<double, SHADES * wide> sides = {};
    for (int a = 0; a < SHADES; ++a) {
        if (with_next) std::copy_n(&knot.next[a * LANES], LANES, &sides[a * wide + next]);
        std::copy_n(&knot.border[a * MOST_ROWS], MOST_ROWS, &sides[a * wide + border]);
        sides[a * wide + unit + a] = 1.0;
    }
    for (int k = 0; k < SHADES; ++k)
        for (int i = k + 1; i < SHADES; ++i) {
            const double factor = matrix[i * LANES + k] / matrix[k * LANES + k];
            add<1>(&matrix[i * LANES], -factor, &matrix[k * LANES]);
            add<count>(&sides[i * wide], -factor, &sides[k * wide]);
        }
    for (int k = SHADES - 1; k >= 0; --k) {
        add<count>(&sides[k * wide], 1.0 / matrix[k * LANES + k] - 1.0, &sides[k * wide]);
        for (int i = 0; i < k; ++i) add<count>(&sides[i * wide], -matrix[i * LANES + k], &sides[k * wide]);
    }
    for (int a = 0; a < SHADES; ++a) {
        std::copy_n(&sides[a * wide + next], LANES, &knot.towards_next[a * LANES]);
        std::copy_n(&sides[a * wide + border], MOST_ROWS, &knot.towards_border[a * MOST_ROWS]);
        std::copy_n(&sides[a * wide + unit], LANES, &knot.inverse[a * LANES]);
    }
}

// Eliminates the shades from the border's equations.
void eliminate(std::vector<Knot>& knots, int rows, Border& border) {
    for (std::size_t i = 0; i < knots.size(); ++i) {
        Knot& knot = knots[i];
        const bool last = i + 1 == knots.size();
        solve(knot, !last);
        for (int a = 0; a < SHADES; ++a) {
            for (int b = 0; b < SHADES && !last; ++b) {
                const double coupling = knot.next[a * LANES + b];
                add<1>(&knots[i + 1].own[b * LANES], -coupling, &knot.towards_next[a * LANES]);
                add<ROW_LANES>(&knots[i + 1].border[b * MOST_ROWS], -coupling, &knot.towards_border[a * MOST_ROWS]);
            }
            for (int r = 0; r < rows; ++r)
                add<ROW_LANES>(&border[r * MOST_ROWS], -knot.border[a * MOST_ROWS + r],
                               &knot.towards_border[a * MOST_ROWS]);
        }
    }
}

// (knots, SHADES) shades and their variances, by back substitution of the border's unknowns.
std::array<Table, 2> substituted(const std::vector<Knot>& knots, const std::vector<double>& change,
                                 const Table& variance) {
    const int count = static_cast<int>(knots.size()), rows = static_cast<int>(change.size());
    std::array<Table, 2> found = {Table(count, SHADES), Table(count, SHADES)};
    Border errors = {};
    for (int r = 0; r < rows; ++r) std::copy_n(variance.row(r).data, rows, &errors[r * MOST_ROWS]);
    std::array<double, MOST_ROWS> moved = {};
    std::copy_n(change.data(), rows, moved.data());
    const auto product = [](const double* one, const double* other) {
        Lanes total = 0.0;
        for (int i = 0; i < MOST_ROWS; i += LANES) total += load(one + i) * load(other + i);
        return sum(total);
    };
    // variances of this knot's shades and of the next one's for a known border, and their derivatives by the border's
    // unknowns
    Block spread = {}, now = {};
    Hanging hanging = {}, hangs = {};
    for (int i = count - 1; i >= 0; --i) {
        const Knot& knot = knots[i];
        const bool last = i + 1 == count;
        now = knot.inverse;
        for (int a = 0; a < SHADES; ++a) {
            double* const own = &hangs[a * MOST_ROWS];
            std::copy_n(&knot.towards_border[a * MOST_ROWS], MOST_ROWS, own);
            found[0](i, a) = own[rows];
            own[rows] = 0.0;
            std::array<double, LANES> with_next = {};  // by the next knot's shades
            if (!last)
                for (int b = 0; b < SHADES; ++b) {
                    const double next = knot.towards_next[a * LANES + b];
                    found[0](i, a) -= next * found[0](i + 1, b);
                    add<ROW_LANES>(own, -next, &hanging[b * MOST_ROWS]);
                    add<1>(with_next.data(), next, &spread[b * LANES]);
                }
            // only towards_border is subtracted: the next knot's part is in its shades
            found[0](i, a) -= product(&knot.towards_border[a * MOST_ROWS], moved.data());
            for (int b = 0; b < SHADES && !last; ++b)
                for (int c = 0; c < SHADES; ++c) now[a * LANES + b] += with_next[c] * knot.towards_next[b * LANES + c];
            std::array<double, MOST_ROWS> of_border = {};  // covariance with the border's unknowns
            for (int r = 0; r < rows; ++r) add<ROW_LANES>(of_border.data(), own[r], &errors[r * MOST_ROWS]);
            found[1](i, a) = now[a * LANES + a] + product(of_border.data(), own);
        }
        spread = now, hanging = hangs;
    }
    return found;
}

Table inverse_of(Table matrix) {
    const int count = matrix.shape[0];
    Table inverse(count, count);
    for (int i = 0; i < count; ++i) inverse(i, i) = 1.0;
    solve_definite(matrix, inverse);
    return inverse;
}

// One Gauss–Newton step from the profiles' equations.
void improve(Line& line, const std::vector<int>& active, int step, int round) {
    const RibbonPriors& model = line.model;
    const int rows = line.border(), splines = line.pieces + 3;
    const bool first = round == 0;
    Border border = {};
    const auto entry = [&](int r, int c) -> double& { return border[r * MOST_ROWS + c]; };
    std::vector<std::vector<Knot>> several;
    for (Channel& channel : line.channels) {
        several.push_back(gathered(line, channel, active, step, border));
        add_priors(channel.spread, channel.contrast, several.back());
    }
    const double bend = model.bend_px * std::pow(line.length_px() / line.pieces / FINEST, 1.5);
    const double here = 0.5 * line.width_px + 1.5;
    constexpr std::array<double, 3> second = {1.0, -2.0, 1.0};
    for (int b = 0; b < splines; ++b) {
        entry(b, b) += first ? 1e8 : 1.0 / square(here);
        if (!first) entry(b, rows) -= line.offset[b] / square(here);
    }
    for (int b = 0; b + 2 < splines; ++b) {
        const double off = line.offset[b] - 2.0 * line.offset[b + 1] + line.offset[b + 2];
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) entry(b + i, b + j) += second[i] * second[j] / square(bend);
            entry(b + i, rows) -= second[i] * off / square(bend);
        }
    }
    const std::array<double, CHANGES> spread = {model.width_std, model.blur_std, model.taper_std};
    for (int s = 0; s < CHANGES; ++s) {
        entry(splines + s, splines + s) += first ? 1e10 : 1.0 / square(spread[s]);
        if (!first) entry(splines + s, rows) -= line.moved[s] / square(spread[s]);
    }
    line.course_information = Table(splines, splines);
    for (int b = 0; b < splines; ++b)
        for (int c = 0; c < splines; ++c) line.course_information(b, c) = entry(b, c);
    for (std::vector<Knot>& knots : several) eliminate(knots, rows, border);
    Table matrix(rows, rows);
    for (int r = 0; r < rows; ++r)
        for (int c = 0; c < rows; ++c) matrix(r, c) = entry(r, c);
    line.variance = inverse_of(std::move(matrix));
    std::vector<double> change(rows);
    for (int r = 0; r < rows; ++r)
        for (int c = 0; c < rows; ++c) change[r] += line.variance(r, c) * entry(c, rows);
    for (int b = 0; b < splines; ++b) change[b] = bounded(change[b], -1.0, 1.0), line.offset[b] += change[b];
    for (int s = 0; s < CHANGES; ++s)
        change[splines + s] = bounded(change[splines + s], -0.3, 0.3), line.moved[s] += change[splines + s];
    const int count = line.count();
    Numbers moves(count);
    for (int n = 0; n < count; ++n) {
        for (int b = 0; b < 4; ++b) moves[n] += line.basis(n, b) * change[line.piece[n] + b];
        line.course[n] += moves[n];
    }
    double whole = 0.0, most = 0.0;
    for (int n : active) whole += line.weight[n];
    whole = std::max(whole, 1e-9);
    for (std::size_t c = 0; c < several.size(); ++c) {
        Channel& channel = line.channels[c];
        const auto [shades, variance] = substituted(several[c], change, line.variance);
        for (int n = 0; n < count; ++n)
            for (int k = 0; k < SHADES; ++k)
                channel.shades(n, k) =
                    (1.0 - line.after[n]) * shades(line.knot[n], k) + line.after[n] * shades(line.knot[n] + 1, k);
        // sizes of the step between the sides, of the background's slope and of the own brightness, from the profiles
        const std::array<double*, 3> size = {&channel.step, &channel.slope, &channel.own};
        std::array<double, 3> power, informed;
        for (int i = 0; i < 3; ++i) power[i] = KNOWN * square(*size[i]), informed[i] = KNOWN;
        double contrast = 0.0;
        for (int n : active) {
            const Reduced& own = channel.equations[n];
            for (int i = 0; i < ALONE; ++i) {
                const double* const by = &own.alone[i * SHARED];
                double value = by[AT_LEVEL] - by[AT_PLACE] * moves[n];
                for (int k = 0; k < SHADES; ++k) value -= by[k] * channel.shades(n, k);
                for (int s = 0; s < CHANGES; ++s) value -= by[AT_PLACE + 1 + s] * change[splines + s];
                channel.alone(n, i) = value;
            }
            const ConstVector alone = channel.alone.row(n);
            const double weight = line.weight[n] / whole, apart = alone[1] - alone[0];
            const std::array<double, 3> value = {apart, alone[2], alone[OWN]};
            for (int i = 0; i < 3; ++i) {
                power[i] += weight * square(value[i]);
                informed[i] += weight * std::max(1.0 - own.variance[i] / square(*size[i]), 0.0);
            }
            contrast += weight * (square(channel.shades(n, 0) - 0.5 * (alone[0] + alone[1])) + 0.25 * square(apart));
        }
        if (!first) {
            const std::array<double, 3> least = {0.1 * channel.noise, 1e-5 * channel.contrast, 0.02 * channel.contrast};
            for (int i = 0; i < 3; ++i) *size[i] = std::max(std::sqrt(power[i] / informed[i]), least[i]);
            channel.contrast = std::sqrt(contrast) + 1e-6;
            for (int k = 1; k < SHADES && round >= GIVEN; ++k) {
                double sum = 4.0 * square(0.3 * channel.spread[k]);
                for (int i = 0; i < line.knots; ++i) sum += square(shades(i, k)) + variance(i, k);
                channel.spread[k] =
                    bounded(std::sqrt(sum / (line.knots + 4.0)), 0.01 * channel.contrast, 2.0 * channel.contrast);
            }
            double next = 1.0;
            for (int far = 0; far < FAR_PX; ++far) {
                if (channel.number[far] > 30.0)
                    next = std::max(channel.power[far] / channel.number[far] / square(channel.noise), 1.0);
                channel.per_structure[far] = 1.0 / next;
            }
        }
        most = std::max(most, channel.contrast);
    }
    for (Channel& channel : line.channels) channel.contrast = std::max(channel.contrast, FAINTEST * most);
}

// Equations of the chosen profiles, and what these count.
void look(Line& line, const std::vector<int>& active, int step, bool first) {
    const int reach = line.channels[0].found->profiles.shape[1] / 2 + 2;
    line.table = shade_table(line.width(), line.blur(), reach);
    const int count = static_cast<int>(active.size());
    for (Channel& channel : line.channels) {
        channel.power.fill(0.0), channel.number.fill(0.0), channel.left.fill(0.0), channel.many.fill(0.0);
        for (int m = 0; m < count; m += LANES) evaluate(line, channel, &active[m], std::min(LANES, count - m), first);
    }
    if (!first) weigh(line, active, step);
}

// Interpolates the own unknowns of profiles that were left out from those of their neighbours.
void fill_between(Line& line, const std::vector<int>& active) {
    const int count = static_cast<int>(active.size());
    const Numbers at_share = each(count, [&](int m) { return line.share[active[m]]; });
    const auto between = [&](auto value) {
        const Numbers known = each(count, [&](int m) { return value(active[m]); });
        return each(line.count(), [&](int n) { return interpolated(at_share, known, line.share[n]); });
    };
    for (Channel& channel : line.channels) {
        for (int i = 0; i < ALONE; ++i) {
            const Numbers values = between([&](int n) { return channel.alone(n, i); });
            for (int n = 0; n < line.count(); ++n) channel.alone(n, i) = values[n];
        }
        channel.rms = between([&](int n) { return channel.rms[n]; });
        channel.inner = between([&](int n) { return channel.inner[n]; });
    }
}

// Shades of the line above the mean of its two sides in profile n.
std::array<double, SHADES> shown(const Channel& channel, int n) {
    std::array<double, SHADES> shades;
    for (int k = 0; k < SHADES; ++k) shades[k] = channel.shades(n, k);
    shades[0] += channel.alone(n, OWN) - 0.5 * (channel.alone(n, 0) + channel.alone(n, 1));
    return shades;
}

Ribbon answer(const Line& line) {
    const Crossings& first = *line.channels[0].found;
    const Table known = inverse_of(line.course_information);
    const double several = static_cast<double>(line.channels.size());
    const int count = line.count();
    Ribbon found;
    found.seen = line.seen;
    for (Numbers* numbers : {&found.centre, &found.sigma_px, &found.shared_px, &found.height})
        *numbers = Numbers(count);
    double power = 0.0, most = 0.0;
    found.strongest = 0;
    for (std::size_t c = 0; c < line.channels.size(); ++c) {
        power += square(line.channels[c].noise);
        const double clear = line.channels[c].contrast / line.channels[c].noise;
        if (clear > most) found.strongest = static_cast<int>(c), most = clear;
    }
    found.noise = std::sqrt(power / several);
    found.pattern = 0.0;
    for (const Channel& channel : line.channels) {
        // symmetric residuals do not move the line, nor do distant ones
        double squares = 0.0, pixels = 1e-9, pairs = 0.0;
        const double per_bin = first.profiles.shape[1] / static_cast<double>(PATTERN);
        for (int bin = 0; bin < PATTERN / 2; ++bin) {
            if ((0.5 * PATTERN - bin - 0.5) * per_bin > 0.5 * line.width() + PULLING_PX) continue;
            const int other = PATTERN - 1 - bin;
            const double one_many = channel.many[bin], other_many = channel.many[other];
            if (std::min(one_many, other_many) < 10.0) continue;
            const double apart = channel.left[bin] / one_many - channel.left[other] / other_many;
            squares += square(apart / channel.noise) / (1.0 / one_many + 1.0 / other_many);
            pixels += one_many + other_many, pairs += 1.0;
        }
        // in excess of noise
        found.pattern += std::max(squares - pairs - 3.0 * std::sqrt(2.0 * pairs), 0.0) / pixels / several;
    }
    found.shades = Table(count, SHADES);
    for (int n = 0; n < count; ++n) {
        double information = 1e-12, side = 0.0, height = 1e-12;
        for (const Channel& channel : line.channels) {
            const Reduced& own = channel.equations[n];
            information += own(AT_PLACE, AT_PLACE);
            side += own(AT_LEVEL, AT_PLACE);
            for (int k = 0; k < SHADES; ++k) side -= own(AT_PLACE, k) * channel.shades(n, k);
            for (double each : shown(channel, n)) height += square(each) / several;
        }
        const std::array<double, SHADES> strongest = shown(line.channels[found.strongest], n);
        for (int k = 0; k < SHADES; ++k) found.shades(n, k) = strongest[k];
        found.height[n] = std::sqrt(height);
        const double off = bounded(side / information, -2.0, 2.0);
        found.centre[n] = (line.course[n] + off) * first.side[n] * first.stretch[n];
        found.sigma_px[n] = 1.0 / std::sqrt(information);
        double more = 0.0;
        for (int b = 0; b < 4; ++b)
            for (int c = 0; c < 4; ++c) {
                const int i = line.piece[n] + b, j = line.piece[n] + c;
                more += line.basis(n, b) * line.basis(n, c) * (line.variance(i, j) - known(i, j));
            }
        found.shared_px[n] = std::sqrt(std::max(more, 0.0));
    }
    found.width_px = line.width(), found.blur_px = line.blur();
    return found;
}

}  // namespace

Ribbon fitted_ribbon(const std::vector<Crossings>& channels, double width_px, double blur_px,
                     const RibbonPriors& model) {
    Line line = begun(channels, width_px, blur_px, model);
    const int count = line.count(), few = std::max(1, count / SOME);
    std::vector<int> active, all;
    for (int n = 0; n < count; ++n) {
        all.push_back(n);
        if (n % few == 0 || n + 1 == count) active.push_back(n);
    }
    int step = few;
    for (int round = 0; round < model.passes; ++round) {
        if (round + 1 == model.passes && step > 1) {
            fill_between(line, active);
            active = all, step = 1;
        }
        look(line, active, step, round == 0);
        improve(line, active, step, round);
    }
    look(line, active, step, false);
    return answer(line);
}

}  // namespace vbaa::detect
