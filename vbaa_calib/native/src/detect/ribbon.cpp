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
constexpr int SOME = 100;            // profiles that are enough until the last rounds
constexpr int LAST_ROUNDS = 1;       // with all profiles
constexpr int GIVEN = 2;             // rounds in which the priors of the shades are as they were given
constexpr double FREED = 6.0;        // unknowns of a profile
constexpr double QUIET = 0.4;        // quantile of residuals taken for the noise
constexpr double LEAST_NOISE = 0.3;  // grey levels: their rounding
constexpr double DISTURBED = 3.0;    // times the noise at which a profile counts half
// Log odds that a profile loses by squares of residuals where the ribbon is, over the noise's, that are more than so
// many.
constexpr double MISFIT = 0.2, ALLOWED = 6.0;
constexpr double UNLIKE = 0.12;  // part of its light that no shade follows
constexpr double MOST_ODDS = 4.0, LEAST_ODDS = -2.5;
constexpr int FAR_PX = 64;           // distances from its edge at which the background's own structure is known
constexpr double MORE_SPREAD = 1.7;  // of normal numbers' variance over that with the weights of pixels
constexpr int EDGES = 3;             // that are tried in its place
constexpr int PATTERN = 32;          // distances from its centre at which residuals are compared along it
constexpr double FAINTEST = 0.15;    // of the strongest channel's contrast
constexpr double FINEST = 20.0;      // px over which a bend's deviation is given

using Unknowns = std::array<Lanes, COLUMNS*(COLUMNS + 1) / 2>;
constexpr int at(int i, int j) { return i * (i + 1) / 2 + j; }  // j ≤ i

// A profile's equations in one channel, without its own unknowns; and these by the others.
struct Reduced {
    std::array<double, SHARED*(SHARED + 1) / 2> left;
    std::array<double, ALONE * SHARED> alone;  // own unknowns: by level, less so much of every other unknown
    std::array<double, ALONE> variance;        // of the step between the sides, of the slope, of the own brightness
};

// One channel as it is known so far.
struct Channel {
    const Crossings* found;
    double contrast, noise, step, own, slope;
    std::array<double, SHADES> spread;         // prior deviations of the shades
    std::array<double, FAR_PX> structure;      // variance over the noise's, by distance from the edge
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
    Numbers after;               // (N,) part of the way from a knot to the next
    Table basis;                 // (N, 4) of the course's splines
    std::vector<double> offset;  // (pieces + 3) of the course
    Table variance;              // of the border's unknowns
    Table course_information;    // of the course, were all else known

    int count() const { return share.size(); }
    double length_px() const { return channels[0].found->along[count() - 1] - channels[0].found->along[0]; }
    int border() const { return pieces + 3 + CHANGES; }
    double width() const { return width_px * std::exp(moved[0]); }
    double blur() const { return blur_px * std::exp(moved[1]); }
    double scale(int n) const { return 1.0 + moved[2] * (share[n] - 0.5); }
};

double prior_of_shade(const RibbonPriors& model, int k) {
    const int harmonic = (k + 1) / 2;
    const double part = 1.2 / (1.0 + harmonic);
    return k == 0 ? 3.0 : part * (k % 2 ? model.sides : model.middles);
}

Line begun(const std::vector<Crossings>& channels, double width_px, double blur_px, const RibbonPriors& model) {
    Line line = {model, width_px, blur_px, {}, {}, {}, {}, {}, {}, 0, 0, {}, {}, {}, {}, {}, {}, {}};
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
        channel.structure.fill(1.0);
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

// Unknowns of an edge alone: levels of both sides and slope; where it is between them, of two odd shades, and by how
// much the ribbon's own level is off the middle: the edge may be, too, by this part of how much the sides differ.
constexpr int OF_EDGE = 6;
constexpr double OFF_MIDDLE = 0.25;

// What of the right side (last row) a system of lanes (lower half) explains.
Lanes explained(std::array<Lanes, (OF_EDGE + 1) * (OF_EDGE + 2) / 2> m) {
    Lanes sum = 0.0;
    for (int k = 0; k < OF_EDGE; ++k) {
        const Lanes pivot = Lanes(1.0) / m[at(k, k)];
        for (int i = k + 1; i <= OF_EDGE; ++i) {
            const Lanes factor = m[at(i, k)] * pivot;
            for (int j = k + 1; j <= i; ++j) m[at(i, j)] -= factor * m[at(j, k)];
        }
        sum += m[at(OF_EDGE, k)] * m[at(OF_EDGE, k)] * pivot;
    }
    return sum;
}

// The equations of up to eight profiles in one channel.
void evaluate(const Line& line, Channel& channel, const Table& table, const int* which, int several, bool first) {
    const Crossings& found = *channel.found;
    const int length = found.profiles.shape[1], last = table.shape[0] - 1;
    Unknowns sums;
    sums.fill(0.0);
    std::array<Lanes, COLUMNS> columns;
    double kinds[SHADE_COLUMNS];
    Lanes squares = 0.0, inner = 0.0, number = 0.0, left = 0.0;
    const double half = 0.5 * line.width();
    const double per_bin = static_cast<double>(PATTERN) / length;
    double coefficients[LANES][FUNCTIONS];
    for (int lane = 0; lane < several; ++lane) {
        const int n = which[lane];
        coefficients[lane][0] = channel.alone(n, 0), coefficients[lane][1] = channel.alone(n, 1);
        for (int k = 0; k < SHADES; ++k) coefficients[lane][SIDES + k] = channel.shades(n, k);
        coefficients[lane][SIDES] += channel.alone(n, OWN);
    }
    for (Lanes& column : columns) column = 0.0;
    for (int t = 0; t < length; ++t) {
        Lanes model = 0.0, variance = 1.0, there = 0.0, within = 0.0;
        std::array<int, LANES> far = {}, bin = {};
        for (int lane = 0; lane < several; ++lane) {
            const int n = which[lane];
            const double along = found.across(n, t) - line.course[n] * found.side[n] * found.stretch[n];
            const double per_scale = 1.0 / line.scale(n);
            const double across = found.side[n] * along * (1.0 / found.stretch[n] + found.bow[n] * along) * per_scale;
            const Place place(across, last);
            const double* const row = table.row(place.row).data;
            for (int i = 0; i < SHADE_COLUMNS; i += LANES) {
                const Lanes one = load(row + i);
                store(kinds + i, one + Lanes(place.far) * (load(row + SHADE_COLUMNS + i) - one));
            }
            const double* const own = coefficients[lane];
            std::array<double, KINDS> parts = {};
            for (int kind = 0; kind < KINDS; ++kind)
                for (int f = 0; f < FUNCTIONS; ++f) parts[kind] += own[f] * kinds[kind * FUNCTIONS + f];
            columns[0][lane] = kinds[0], columns[1][lane] = kinds[1], columns[2][lane] = across;
            columns[OWN][lane] = kinds[SIDES];
            for (int k = 0; k < SHADES; ++k) columns[FIRST + k][lane] = kinds[SIDES + k];
            columns[PLACE][lane] = -parts[BY_DISTANCE] * per_scale;
            columns[WIDER][lane] = parts[BY_WIDTH];
            columns[SOFTER][lane] = parts[BY_BLUR];
            columns[TAPER][lane] = parts[BY_WIDTH] * (line.share[n] - 0.5);
            columns[LEVEL][lane] = found.profiles(n, t);
            model[lane] = parts[VALUE] + channel.alone(n, 2) * across;
            far[lane] = static_cast<int>(bounded(std::abs(across) - half, 0.0, FAR_PX - 1));
            variance[lane] = square(channel.noise) * channel.structure[far[lane]];
            bin[lane] = static_cast<int>(bounded(across * per_bin + 0.5 * PATTERN, 0.0, PATTERN - 1.0));
            there[lane] = found.inside[n] ? 1.0 : 0.0;
            within[lane] = std::abs(across) < half + 1.0 ? 1.0 : 0.0;
        }
        Lanes weight = there / variance;
        if (!first) {
            const Lanes residual = columns[LEVEL] - model, power = residual * residual;
            const Lanes counted = Lanes(1.0) / (Lanes(1.0) + power / (Lanes(square(line.model.cut)) * variance));
            weight *= counted;
            squares += there * power;
            inner += within * power;
            number += within;
            left += weight * power;
            for (int lane = 0; lane < several; ++lane)
                if (channel.rms[which[lane]] < 2.5 * channel.noise && line.seen[which[lane]] > 0.5) {
                    channel.power[far[lane]] += MORE_SPREAD * counted[lane] * power[lane];
                    channel.number[far[lane]] += counted[lane];
                    channel.left[bin[lane]] += residual[lane], channel.many[bin[lane]] += 1.0;
                }
        }
        for (int i = 0; i < COLUMNS; ++i) {
            const Lanes weighted = weight * columns[i];
            for (int j = 0; j <= i; ++j) sums[at(i, j)] += weighted * columns[j];
        }
    }
    const double step = 1.0 / square(channel.step), loose = 1e-6 / square(channel.contrast);
    sums[at(0, 0)] += step + loose, sums[at(1, 1)] += step + loose, sums[at(1, 0)] -= step;
    sums[at(2, 2)] += 1.0 / square(channel.slope);
    if (!first) {
        // one edge alone: the ribbon is as bright as the left side, or as the right one, or between them, on its one
        // side so, on its other otherwise
        const auto product = [&](int i, int j) { return sums[i > j ? at(i, j) : at(j, i)]; };
        // squares of how much the sides differ
        Lanes apart = square(channel.noise);
        for (int lane = 0; lane < several; ++lane)
            apart[lane] = apart[lane] + square(channel.alone(which[lane], 1) - channel.alone(which[lane], 0));
        std::array<Lanes, EDGES> instead;
        for (int edge = 0; edge < EDGES; ++edge) {
            const double own[2] = {edge == 0 ? 1.0 : edge == 1 ? 0.0 : 0.5, edge == 0 ? 0.0 : edge == 1 ? 1.0 : 0.5};
            constexpr int others[OF_EDGE + 1] = {0, 1, 2, FIRST + 1, FIRST + 3, OWN, LEVEL};
            std::array<Lanes, (OF_EDGE + 1) * (OF_EDGE + 2) / 2> system;
            for (int i = 0; i <= OF_EDGE; ++i)
                for (int j = 0; j <= i; ++j) {
                    Lanes value = product(others[i], others[j]);
                    if (i < 2) value += Lanes(own[i]) * product(OWN, others[j]);
                    if (j < 2) value += Lanes(own[j]) * product(others[i], OWN);
                    if (i < 2 && j < 2) value += Lanes(own[i] * own[j]) * product(OWN, OWN);
                    const bool between = (i > 2 && i < OF_EDGE) || (j > 2 && j < OF_EDGE);
                    if (between && edge < 2) value = i == j ? 1.0 : 0.0;
                    if (between && i == j && edge == 2)
                        value += i == 5 ? Lanes(1.0 / square(OFF_MIDDLE)) / apart : Lanes(1.0) / apart;
                    system[at(i, j)] = value;
                }
            instead[edge] = sums[at(LEVEL, LEVEL)] - left - explained(system);
        }
        for (int lane = 0; lane < several; ++lane) {
            for (int edge = 0; edge < EDGES; ++edge) channel.edges[edge][which[lane]] = instead[edge][lane];
            channel.rms[which[lane]] = std::sqrt(squares[lane] / std::max(length - FREED, 3.0));
            channel.inner[which[lane]] = std::sqrt(inner[lane] / std::max<double>(number[lane], 1.0));
        }
    }
    sums[at(OWN, OWN)] += 1.0 / square(channel.own);
    // eliminate a profile's own unknowns, the last one first of all that are solved for
    for (int k = 0; k < ALONE; ++k) {
        const Lanes pivot = Lanes(1.0) / sums[at(k, k)];
        for (int i = k + 1; i < COLUMNS; ++i) {
            const Lanes factor = sums[at(i, k)] * pivot;
            for (int j = k + 1; j <= i; ++j) sums[at(i, j)] -= factor * sums[at(j, k)];
        }
    }
    for (int lane = 0; lane < several; ++lane) {
        Reduced& to = channel.equations[which[lane]];
        for (int i = ALONE, m = 0; i < COLUMNS; ++i)
            for (int j = ALONE; j <= i; ++j, ++m) to.left[m] = sums[at(i, j)][lane];
        // own unknowns by the others: back substitution of L D Lᵀ
        double factor[ALONE][ALONE], pivot[ALONE];
        for (int k = 0; k < ALONE; ++k) {
            pivot[k] = sums[at(k, k)][lane];
            for (int i = k + 1; i < ALONE; ++i) factor[i][k] = sums[at(i, k)][lane] / pivot[k];
        }
        for (int s = 0; s < SHARED; ++s)
            for (int k = ALONE - 1; k >= 0; --k) {
                double value = sums[at(ALONE + s, k)][lane] / pivot[k];
                for (int i = k + 1; i < ALONE; ++i) value -= factor[i][k] * to.alone[i * SHARED + s];
                to.alone[k * SHARED + s] = value;
            }
        const auto variance_of = [&](std::array<double, ALONE> row) {
            double value = 0.0;
            for (int k = 0; k < ALONE; ++k) {
                for (int i = k + 1; i < ALONE; ++i) row[i] -= factor[i][k] * row[k];
                value += row[k] * row[k] / pivot[k];
            }
            return value;
        };
        to.variance = {variance_of({-1.0, 1.0, 0.0, 0.0}), variance_of({0.0, 0.0, 1.0, 0.0}),
                       variance_of({0.0, 0.0, 0.0, 1.0}), 0.0};
    }
}

// Probabilities (M,) to be seen by a chain of two states that changes at this rate, from log odds (M,).
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
    double one = 0.5, other = 0.5;  // likelihood of what comes after, where it is hidden and where it is seen
    for (int n = count - 1; n >= 0; --n) {
        const double away = before[n] * one, here = (1.0 - before[n]) * other;
        probability[n] = here / (away + here);
        const double was = one, now = other * std::exp(odds[n]);
        // what the profile itself says counts for those before it
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

// What residuals a profile may have: noise, and that part of its light which no shade follows.
double expected_rms(const Channel& channel, int n) {
    return std::sqrt(square(channel.noise) + square(UNLIKE) * shown_power(channel, n));
}

// Which profiles show it, and how much each counts.
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
        const double least = part * *std::min_element(edges.begin(), edges.end()) + line.model.hidden;
        return bounded(bounded(least, LEAST_ODDS, MOST_ODDS) - MISFIT * std::max(misfit - ALLOWED, 0.0), LEAST_ODDS,
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

// A channel's equations along its knots: neighbours' blocks, how they hang on the border, and the right side.
struct Knots {
    std::vector<Table> own, next, border;  // (SHADES, SHADES) twice, and (SHADES, border + 1)
    std::vector<Table> towards_next, towards_border, inverse;
};

// Adds the profiles of a channel; and what they say of the border, (border, border + 1).
Knots gathered(const Line& line, const Channel& channel, const std::vector<int>& active, double per_profile,
               Table& border) {
    const int rows = line.border(), splines = line.pieces + 3;
    Knots knots;
    for (int k = 0; k < line.knots; ++k) {
        knots.own.emplace_back(SHADES, SHADES);
        knots.next.emplace_back(SHADES, SHADES);
        knots.border.emplace_back(SHADES, rows + 1);
    }
    for (int n : active) {
        const double weight = line.weight[n] * per_profile, after = line.after[n], parts[2] = {1.0 - after, after};
        if (!(weight > 1e-4)) continue;
        const auto& own = channel.equations[n].left;
        const int knot = line.knot[n], piece = line.piece[n];
        const ConstVector basis = line.basis.row(n);
        for (int i = 0; i < SHADES; ++i)
            for (int j = 0; j <= i; ++j) {
                const double value = weight * own[at(i, j)];
                for (int p = 0; p < 2; ++p) {
                    knots.own[knot + p](i, j) += parts[p] * parts[p] * value;
                    if (i != j) knots.own[knot + p](j, i) += parts[p] * parts[p] * value;
                }
                knots.next[knot](i, j) += parts[0] * parts[1] * value;
                if (i != j) knots.next[knot](j, i) += parts[0] * parts[1] * value;
            }
        for (int p = 0; p < 2; ++p)
            for (int i = 0; i < SHADES; ++i) {
                double* const row = knots.border[knot + p].row(i).data;
                const double part = parts[p] * weight;
                for (int b = 0; b < 4; ++b) row[piece + b] += part * basis[b] * own[at(AT_PLACE, i)];
                for (int s = 0; s < CHANGES; ++s) row[splines + s] += part * own[at(AT_PLACE + 1 + s, i)];
                row[rows] += part * own[at(AT_LEVEL, i)];
            }
        for (int b = 0; b < 4; ++b) {
            for (int c = 0; c < 4; ++c)
                border(piece + b, piece + c) += weight * basis[b] * basis[c] * own[at(AT_PLACE, AT_PLACE)];
            for (int s = 0; s < CHANGES; ++s) {
                const double value = weight * basis[b] * own[at(AT_PLACE + 1 + s, AT_PLACE)];
                border(piece + b, splines + s) += value;
                border(splines + s, piece + b) += value;
            }
            border(piece + b, rows) += weight * basis[b] * own[at(AT_LEVEL, AT_PLACE)];
        }
        for (int s = 0; s < CHANGES; ++s) {
            for (int r = 0; r < CHANGES; ++r)
                border(splines + s, splines + r) +=
                    weight * own[at(AT_PLACE + 1 + std::max(s, r), AT_PLACE + 1 + std::min(s, r))];
            border(splines + s, rows) += weight * own[at(AT_LEVEL, AT_PLACE + 1 + s)];
        }
    }
    return knots;
}

// Priors of a channel's shades: how large they are, and how much they change from knot to knot.
void add_priors(const Line& line, const std::array<double, SHADES>& spread, double contrast, Knots& knots) {
    for (int k = 0; k < SHADES; ++k) {
        const double change = 1.0 / square(k ? 0.5 * spread[k] : 0.7 * contrast);
        for (int i = 0; i < line.knots; ++i) {
            knots.own[i](k, k) += (i && i + 1 < line.knots ? 2.0 : 1.0) * change +
                                  (k ? 1.0 / square(spread[k]) : 1e-6 / square(contrast));
            if (i + 1 < line.knots) knots.next[i](k, k) -= change;
        }
    }
}

// Eliminates the shades: takes what they explain from the border's equations.
void eliminate(Knots& knots, int rows, Table& border) {
    const int count = static_cast<int>(knots.own.size());
    for (int i = 0; i < count; ++i) {
        Table sides(SHADES, SHADES + rows + 1 + SHADES), matrix = knots.own[i];
        for (int a = 0; a < SHADES; ++a) {
            for (int b = 0; b < SHADES; ++b) sides(a, b) = i + 1 < count ? knots.next[i](a, b) : 0.0;
            for (int r = 0; r <= rows; ++r) sides(a, SHADES + r) = knots.border[i](a, r);
            sides(a, SHADES + rows + 1 + a) = 1.0;
        }
        solve_definite(matrix, sides);
        Table next(SHADES, SHADES), towards(SHADES, rows + 1), inverse(SHADES, SHADES);
        for (int a = 0; a < SHADES; ++a) {
            for (int b = 0; b < SHADES; ++b) next(a, b) = sides(a, b), inverse(a, b) = sides(a, SHADES + rows + 1 + b);
            for (int r = 0; r <= rows; ++r) towards(a, r) = sides(a, SHADES + r);
        }
        if (i + 1 < count)
            for (int a = 0; a < SHADES; ++a)
                for (int b = 0; b < SHADES; ++b) {
                    const double coupling = knots.next[i](a, b);
                    if (coupling == 0.0) continue;
                    for (int c = 0; c < SHADES; ++c) knots.own[i + 1](b, c) -= coupling * next(a, c);
                    for (int r = 0; r <= rows; ++r) knots.border[i + 1](b, r) -= coupling * towards(a, r);
                }
        for (int a = 0; a < SHADES; ++a)
            for (int r = 0; r < rows; ++r) {
                const double coupling = knots.border[i](a, r);
                for (int c = 0; c <= rows; ++c) border(r, c) -= coupling * towards(a, c);
            }
        knots.towards_next.push_back(std::move(next));
        knots.towards_border.push_back(std::move(towards));
        knots.inverse.push_back(std::move(inverse));
    }
}

// (knots, SHADES) the shades and their variances, once the border's unknowns are known.
std::array<Table, 2> substituted(const Knots& knots, const std::vector<double>& border, const Table& variance) {
    const int count = static_cast<int>(knots.own.size()), rows = static_cast<int>(border.size());
    std::array<Table, 2> found = {Table(count, SHADES), Table(count, SHADES)};
    Table spread(SHADES, SHADES), hanging(SHADES, rows);
    for (int i = count - 1; i >= 0; --i) {
        Table now = knots.inverse[i], hangs(SHADES, rows), product(SHADES, SHADES);
        const Table& next = knots.towards_next[i];
        for (int a = 0; a < SHADES; ++a) {
            found[0](i, a) = knots.towards_border[i](a, rows);
            for (int r = 0; r < rows; ++r) {
                found[0](i, a) -= knots.towards_border[i](a, r) * border[r];
                hangs(a, r) = knots.towards_border[i](a, r);
            }
            if (i + 1 == count) continue;
            for (int b = 0; b < SHADES; ++b) {
                found[0](i, a) -= next(a, b) * found[0](i + 1, b);
                for (int r = 0; r < rows; ++r) hangs(a, r) -= next(a, b) * hanging(b, r);
                for (int c = 0; c < SHADES; ++c) product(a, c) += next(a, b) * spread(b, c);
            }
        }
        if (i + 1 < count)
            for (int a = 0; a < SHADES; ++a)
                for (int b = 0; b < SHADES; ++b)
                    for (int c = 0; c < SHADES; ++c) now(a, b) += product(a, c) * next(b, c);
        spread = std::move(now), hanging = std::move(hangs);
        for (int a = 0; a < SHADES; ++a) {
            found[1](i, a) = spread(a, a);
            for (int r = 0; r < rows; ++r)
                for (int c = 0; c < rows; ++c) found[1](i, a) += hanging(a, r) * variance(r, c) * hanging(a, c);
        }
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
    Table border(rows, rows + 1);
    std::vector<Knots> several;
    for (Channel& channel : line.channels) {
        several.push_back(gathered(line, channel, active, step, border));
        add_priors(line, channel.spread, channel.contrast, several.back());
    }
    const double bend = model.bend_px * std::pow(line.length_px() / line.pieces / FINEST, 1.5);
    const double here = 0.5 * line.width_px + 1.5;
    constexpr std::array<double, 3> second = {1.0, -2.0, 1.0};
    for (int b = 0; b < splines; ++b) {
        border(b, b) += first ? 1e8 : 1.0 / square(here);
        if (!first) border(b, rows) -= line.offset[b] / square(here);
    }
    for (int b = 0; b + 2 < splines; ++b) {
        const double off = line.offset[b] - 2.0 * line.offset[b + 1] + line.offset[b + 2];
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) border(b + i, b + j) += second[i] * second[j] / square(bend);
            border(b + i, rows) -= second[i] * off / square(bend);
        }
    }
    const std::array<double, CHANGES> spread = {model.width_std, model.blur_std, model.taper_std};
    for (int s = 0; s < CHANGES; ++s) {
        border(splines + s, splines + s) += first ? 1e10 : 1.0 / square(spread[s]);
        if (!first) border(splines + s, rows) -= line.moved[s] / square(spread[s]);
    }
    line.course_information = Table(splines, splines);
    for (int b = 0; b < splines; ++b)
        for (int c = 0; c < splines; ++c) line.course_information(b, c) = border(b, c);
    for (Knots& knots : several) eliminate(knots, rows, border);
    Table matrix(rows, rows);
    for (int r = 0; r < rows; ++r)
        for (int c = 0; c < rows; ++c) matrix(r, c) = border(r, c);
    line.variance = inverse_of(std::move(matrix));
    std::vector<double> change(rows);
    for (int r = 0; r < rows; ++r)
        for (int c = 0; c < rows; ++c) change[r] += line.variance(r, c) * border(c, rows);
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
        double steps = 0.0, slopes = 0.0, owns = 0.0, contrast = 0.0;
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
            steps += weight * (square(apart) + own.variance[0]);
            slopes += weight * (square(alone[2]) + own.variance[1]);
            owns += weight * (square(alone[OWN]) + own.variance[2]);
            contrast += weight * (square(channel.shades(n, 0) - 0.5 * (alone[0] + alone[1])) + 0.25 * square(apart));
        }
        if (!first) {
            channel.step = std::sqrt(std::max(steps, 0.01 * square(channel.noise)));
            channel.slope = std::sqrt(std::max(slopes, square(1e-5 * channel.contrast)));
            channel.own = std::sqrt(std::max(owns, square(0.02 * channel.contrast)));
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
                channel.structure[far] = next;
            }
        }
        most = std::max(most, channel.contrast);
    }
    for (Channel& channel : line.channels) channel.contrast = std::max(channel.contrast, FAINTEST * most);
}

// Equations of the chosen profiles, and what these count.
void look(Line& line, const std::vector<int>& active, int step, bool first) {
    const int reach = line.channels[0].found->profiles.shape[1] / 2 + 2;
    const Table table = shade_table(line.width(), line.blur(), reach);
    const int count = static_cast<int>(active.size());
    for (Channel& channel : line.channels) {
        channel.power.fill(0.0), channel.number.fill(0.0), channel.left.fill(0.0), channel.many.fill(0.0);
        for (int m = 0; m < count; m += LANES)
            evaluate(line, channel, table, &active[m], std::min(LANES, count - m), first);
    }
    if (!first) weigh(line, active, step);
}

// A profile's own unknowns, where it was left out so far: as those of its neighbours.
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

// What a line shows above the mean of its two sides in profile n.
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
    for (Numbers* numbers : {&found.centre, &found.sigma_px, &found.shared_px, &found.height, &found.rms})
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
        double squares = 0.0, pixels = 1e-9, bins = 0.0;
        for (int bin = 0; bin < PATTERN; ++bin) {
            if (channel.many[bin] < 10.0) continue;
            squares += square(channel.left[bin]) / channel.many[bin] / square(channel.noise);
            pixels += channel.many[bin], bins += 1.0;
        }
        // more than noise makes
        found.pattern += std::max(squares - bins - 3.0 * std::sqrt(2.0 * bins), 0.0) / pixels / several;
    }
    found.shades = Table(count, SHADES);
    for (int n = 0; n < count; ++n) {
        double information = 1e-12, side = 0.0, residual = 0.0, height = 1e-12;
        for (const Channel& channel : line.channels) {
            const auto& own = channel.equations[n].left;
            information += own[at(AT_PLACE, AT_PLACE)];
            side += own[at(AT_LEVEL, AT_PLACE)];
            for (int k = 0; k < SHADES; ++k) side -= own[at(AT_PLACE, k)] * channel.shades(n, k);
            for (double each : shown(channel, n)) height += square(each) / several;
            residual += square(channel.rms[n] / expected_rms(channel, n)) / several;
        }
        const std::array<double, SHADES> strongest = shown(line.channels[found.strongest], n);
        for (int k = 0; k < SHADES; ++k) found.shades(n, k) = strongest[k];
        found.height[n] = std::sqrt(height);
        found.rms[n] = std::sqrt(residual);
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
        if (round + LAST_ROUNDS == model.passes && step > 1) {
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
