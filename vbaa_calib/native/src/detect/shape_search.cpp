#include "detect/shape_search.hpp"

#include <cstring>

#include "detect/ridges.hpp"
#include "lanes.hpp"
#include "polyline.hpp"
#include "smooth.hpp"

namespace vbaa::detect {
namespace {

constexpr int AT_ONCE = 16;         // turns of the tip that are tried at once
constexpr int FINER = 4;            // a strip's odds are tabled at so many places a step
constexpr double CERTAIN_PX = 4.0;  // if the clamp may be moved by less, its place is not searched for
constexpr double LOOSE_PX = 20.0;   // most by which it is searched for
constexpr double AROUND_PX = 10.0;  // of a path, that is visible next to its width
constexpr double AROUND_ROUGH_PX = 4.0;
constexpr double TURN_RAD = 0.25;        // by which a shape's tip may be turned from the rough path's
constexpr double NOISE_PLACES = 3000.0;  // places in a picture that determine its noise to some hundredths
constexpr double FINE_TURN_RAD = 0.02, FINE_OFFSET_PX = 0.5, FINE_CLAMP_RAD = 0.005;  // steps about a shape
constexpr double LEAST_CONTACT = 0.06, MOST_CONTACT = 1.9;                            // parts of the length

using Point = std::array<double, 2>;
using Bend = std::array<double, 4>;  // contact, turn of the tip (rad), offset (px) and turn (rad) at the clamp

// Shapes about a free axis (S, 2): its headings, and how a force at a place bends them.
struct Axis {
    int count;
    double step, length;
    Point start, normal;
    Numbers cosine, sine;
};

Axis axis_of(ConstMatrix points) {
    const int count = points.shape[0];
    const double length = arc_lengths(points)[count - 1];
    const Table across = normals(points);
    return {count,
            length / (count - 1),
            length,
            {points(0, 0), points(0, 1)},
            {across(0, 0), across(0, 1)},
            each(count, [&](int s) { return across(s, 1); }),
            each(count, [&](int s) { return -across(s, 0); })};
}

// Sine and cosine of an angle of less than 2.5 rad, to 1e-6.
template <class Number>
inline void turned(Number angle, Number& sine, Number& cosine) {
    const auto number = [](auto value) { return Number(static_cast<float>(value)); };
    const Number one = number(1.0), two = number(2.0), part = number(0.25) * angle, q = part * part;
    const Number s = part * (one - q * (number(1.0 / 6.0) - q * (number(1.0 / 120.0) - q * number(1.0 / 5040.0))));
    const Number c = one - q * (number(0.5) - q * (number(1.0 / 24.0) - q * number(1.0 / 720.0)));
    const Number s2 = two * s * c, c2 = one - two * s * s;
    sine = two * s2 * c2;
    cosine = one - two * s2 * s2;
}

// (S,) how far the direction has turned, over the turn of the tip, where a force acts at a part of the length.
Numbers turn_shares(const Axis& axis, double contact) {
    const auto share_of = [](double reach) { return reach < 1.0 ? reach * (2.0 - reach) : 1.0; };
    const double whole = share_of(1.0 / contact);
    return each(axis.count, [&](int s) { return share_of(s / ((axis.count - 1) * contact)) / whole; });
}

// (S, 2) the shape of a bend: turned as by a force at a part `contact` of its length, moved and turned at the clamp.
Table bent(const Axis& axis, const Bend& bend) {
    const auto [contact, turn, offset, rotation] = bend;
    const Numbers shares = turn_shares(axis, contact);
    Table path(axis.count, 2);
    Point at = {axis.start[0] + offset * axis.normal[0], axis.start[1] + offset * axis.normal[1]}, before = {};
    for (int s = 0; s < axis.count; ++s) {
        double sine, cosine;
        turned(rotation + turn * shares[s], sine, cosine);
        const Point heading = {axis.cosine[s] * cosine - axis.sine[s] * sine,
                               axis.sine[s] * cosine + axis.cosine[s] * sine};
        for (int i = 0; i < 2; ++i) {
            if (s) at[i] += 0.5 * axis.step * (before[i] + heading[i]);
            path(s, i) = at[i];
        }
        before = heading;
    }
    return path;
}

// Log odds (S,) of a shape along a strip about another one much like it.
Numbers odds_along(const Strip& strip, const Table& path, double hidden) {
    const int last = strip.odds.shape[1] - 2;
    return each(path.shape[0], [&](int s) {
        const double off =
            (path(s, 0) - strip.path(s, 0)) * strip.normal(s, 0) + (path(s, 1) - strip.path(s, 1)) * strip.normal(s, 1);
        const double place = (off - strip.first) / STRIP_STEP_PX;
        if (!(place >= 0.0 && place < last + 1.0)) return 2.0 * hidden;
        const int m = static_cast<int>(place);
        const double one = strip.odds(s, m), other = strip.odds(s, m + 1);
        return one + (place - m) * (other - one);
    });
}

// A strip tabulated for the family: several stations are summed where its shapes are much alike.
struct Tabled {
    int rows, places, bunch;  // stations and so many places across each
    double first;             // offset (px) of the first place but one: before and after are those beyond the strip
    Array<float, 2> odds;     // (rows, places) sums over a row's stations
    const Strip& strip;

    Tabled(const Strip& from, int stations, double hidden)
        : rows((from.path.shape[0] + stations - 1) / stations),
          places(std::max(FINER * (from.odds.shape[1] - 1) + 1, 0) + 2),
          bunch(stations),
          first(from.first),
          odds(rows, places),
          strip(from) {
        const int count = from.path.shape[0], middles = from.odds.shape[1];
        for (int s = 0; s < count; ++s) {
            float* const __restrict to = odds.row(s / bunch).data;
            to[0] += static_cast<float>(2.0 * hidden);
            to[places - 1] += static_cast<float>(2.0 * hidden);
            for (int m = 0; m < middles; ++m) {
                const float one = from.odds(s, m), rise = m + 1 < middles ? from.odds(s, m + 1) - one : 0.0f;
                for (int i = 0; i < (m + 1 < middles ? FINER : 1); ++i)
                    to[1 + m * FINER + i] += one + static_cast<float>(i) / FINER * rise;
            }
        }
    }
};

// One number for each of the turns that are tried at once.
using Turns = Pack<float, AT_ONCE * sizeof(float)>;

// Places across a strip's rows of shapes with one contact, as functions of the turn and the offset at the clamp.
struct Across {
    std::vector<Turns> along, lateral;        // (rows) with the cosine, and the sine, of the turn at the clamp
    std::vector<float> at_rest, with_offset;  // (rows) without any, and with its offset
};

// Lays `AT_ONCE` shapes, with turns in equal steps from `turn` on, across a strip.
void lay_across(const Axis& axis, const Numbers& shares, const Tabled& tabled, double turn, double step, Across& to) {
    const float per_px = static_cast<float>(FINER / STRIP_STEP_PX);
    Turns turns, u = 0.0f, v = 0.0f, before_u = 0.0f, before_v = 0.0f;
    for (int lane = 0; lane < AT_ONCE; ++lane) turns[lane] = static_cast<float>(turn + lane * step);
    to.along.assign(tabled.rows, 0.0f), to.lateral.assign(tabled.rows, 0.0f);
    to.at_rest.assign(tabled.rows, 0.0f), to.with_offset.assign(tabled.rows, 0.0f);
    const float half = static_cast<float>(0.5 * axis.step);
    for (int s = 0; s < axis.count; ++s) {
        Turns sine, cosine;
        turned<Turns>(turns * Turns(static_cast<float>(shares[s])), sine, cosine);
        const float c = static_cast<float>(axis.cosine[s]), d = static_cast<float>(axis.sine[s]);
        const Turns to_u = Turns(c) * cosine - Turns(d) * sine, to_v = Turns(d) * cosine + Turns(c) * sine;
        if (s) {
            u += Turns(half) * (before_u + to_u);
            v += Turns(half) * (before_v + to_v);
        }
        before_u = to_u, before_v = to_v;
        const int row = s / tabled.bunch, several = std::min(tabled.bunch, axis.count - row * tabled.bunch);
        const Strip& strip = tabled.strip;
        const double nu = strip.normal(s, 0), nv = strip.normal(s, 1);
        const float share = per_px / static_cast<float>(several);
        const float a = share * static_cast<float>(nu), b = share * static_cast<float>(nv);
        to.along[row] += Turns(a) * u + Turns(b) * v;
        to.lateral[row] += Turns(b) * u - Turns(a) * v;
        const double at_rest = (axis.start[0] - strip.path(s, 0)) * nu + (axis.start[1] - strip.path(s, 1)) * nv;
        to.at_rest[row] += share * static_cast<float>(at_rest - tabled.first);
        to.with_offset[row] += share * static_cast<float>(axis.normal[0] * nu + axis.normal[1] * nv);
    }
}

// Offsets or turns tried at the clamp, in equal steps to either side of a bend's own.
struct Grid {
    int steps = 0;
    double middle = 0.0, step = 0.0;
    int count() const { return 2 * steps + 1; }
    double at(int k) const { return middle + step * (k - steps); }
};

// Sums of log odds of shapes: into (turns at the clamp, offsets, AT_ONCE).
void sum_odds(const Tabled& tabled, const Across& across, const Grid& offsets, const Grid& rotations,
              std::vector<Turns>& sums) {
    sums.assign(static_cast<std::size_t>(offsets.count()) * rotations.count(), 0.0f);
    const float last = static_cast<float>(tabled.places - 1);
    for (int r = 0; r < rotations.count(); ++r) {
        const float cosine = static_cast<float>(std::cos(rotations.at(r))),
                    sine = static_cast<float>(std::sin(rotations.at(r)));
        for (int row = 0; row < tabled.rows; ++row) {
            const float* const odds = tabled.odds.row(row).data;
            // one for the place beyond, a half for the nearest
            const Turns place = Turns(cosine) * across.along[row] + Turns(sine) * across.lateral[row] +
                                Turns(across.at_rest[row] + 1.5f);
            for (int o = 0; o < offsets.count(); ++o) {
                const float by = static_cast<float>(offsets.at(o)) * across.with_offset[row];
                float found[AT_ONCE];
                int at[AT_ONCE];
                std::memcpy(found, &place, sizeof(found));
                for (int lane = 0; lane < AT_ONCE; ++lane)
                    at[lane] = static_cast<int>(std::min(std::max(0.0f, found[lane] + by), last));
                for (int lane = 0; lane < AT_ONCE; ++lane) found[lane] = odds[at[lane]];
                Turns more;
                std::memcpy(&more, found, sizeof(found));
                sums[r * offsets.count() + o] += more;
            }
        }
    }
}

// A search's pieces that do not change from path to path.
template <class T>
struct Search {
    const Colours<T>& picture;
    const ShapeFamily& family;
    const Axis axis;
    const StripModel strips;
    const EdgeModel& model;

    double prior(const Bend& bend) const {
        const double strain = bend[1] * family.width_px / (std::min(bend[0], 1.0) * axis.length) / model.strain;
        return -0.5 * strain * strain;
    }
    double evidence(double mean_odds, const Bend& bend) const {
        return axis.length / model.correlation_px * mean_odds + prior(bend);
    }
};

// A shape, and the evidence for it along a strip.
struct Candidate {
    double evidence;
    Bend bend;
};

// The shapes tried of a family.
struct Tried {
    std::vector<double> contacts;
    Grid turns, offsets, rotations;
};

// The highest sum for each turn, and its place.
struct Highest {
    std::array<float, AT_ONCE> sum;
    std::array<int, AT_ONCE> at;

    explicit Highest(const std::vector<Turns>& sums) : at{} {
        sum.fill(-INFINITY);
        for (int k = 0; k < static_cast<int>(sums.size()); ++k) {
            float own[AT_ONCE];
            std::memcpy(own, &sums[k], sizeof(own));
            for (int lane = 0; lane < AT_ONCE; ++lane) {
                at[lane] = own[lane] > sum[lane] ? k : at[lane];
                sum[lane] = std::max(sum[lane], own[lane]);
            }
        }
    }
};

// The best of a family along a strip.
template <class T>
Candidate best_of(const Search<T>& search, const Tabled& tabled, const Tried& tried) {
    Candidate best = {-INFINITY, {1.0, 0.0, 0.0, 0.0}};
    Across across;
    std::vector<Turns> sums;
    for (const double contact : tried.contacts) {
        const Numbers shares = turn_shares(search.axis, contact);
        for (int first = 0; first < tried.turns.count(); first += AT_ONCE) {
            lay_across(search.axis, shares, tabled, tried.turns.at(first), tried.turns.step, across);
            sum_odds(tabled, across, tried.offsets, tried.rotations, sums);
            const Highest highest(sums);
            for (int lane = 0; lane < std::min(AT_ONCE, tried.turns.count() - first); ++lane) {
                const int at = highest.at[lane], offsets = tried.offsets.count();
                const Bend bend = {contact, tried.turns.at(first + lane), tried.offsets.at(at % offsets),
                                   tried.rotations.at(at / offsets)};
                const double mean = static_cast<double>(highest.sum[lane]) / search.axis.count;
                const double evidence = search.evidence(mean, bend);
                if (evidence > best.evidence) best = {evidence, bend};
            }
        }
    }
    return best;
}

// (S, 2) a path at as many points as the axis has.
Table even(ConstMatrix rough, int count) {
    const Numbers along = arc_lengths(rough);
    const int last = rough.shape[0] - 1;
    Table path(count, 2);
    for (int i = 0; i < 2; ++i) {
        const Numbers values = each(last + 1, [&](int k) { return rough(k, i); });
        for (int s = 0; s < count; ++s) path(s, i) = interpolated(along, values, along[last] * s / (count - 1));
    }
    return path;
}

// Direction of a line's last tenth.
double heading(ConstMatrix line) {
    const int last = line.shape[0] - 1, before = std::max(last - std::max(last / 10, 1), 0);
    return std::atan2(line(last, 1) - line(before, 1), line(last, 0) - line(before, 0));
}

// The best shape near a rough path, dense enough to be found in finer rounds.
template <class T>
Candidate best_near(const Search<T>& search, ConstMatrix rough) {
    const ShapeFamily& family = search.family;
    const bool certain = family.clamp_px < CERTAIN_PX;
    const double loose = certain ? AROUND_ROUGH_PX : std::min(family.clamp_px, LOOSE_PX);
    const double reach = 1.2 * family.spacing_px + 0.5 * family.width_px + AROUND_PX + loose;
    const Table path = even(rough, search.axis.count);
    const Strip strip = strip_along(search.picture, path, reach, search.strips);
    const double turn = std::remainder(heading(path) - heading(family.axis_px), 2.0 * M_PI);
    const double fine = (certain ? 4.0 : 8.0) / search.axis.length;  // the tip moves by half of that
    Tried tried = {{family.contacts.begin(), family.contacts.end()},
                   {static_cast<int>(std::ceil(TURN_RAD / fine)), turn, fine},
                   {0, 0.0, 0.0},
                   {0, 0.0, 0.0}};
    if (!certain) {
        tried.offsets = {6, 0.0, loose / 6};
        tried.rotations = {3, 0.0, family.clamp_rad / 3};
    }
    return best_of(search, Tabled(strip, 1, search.model.hidden), tried);
}

// Refines a shape on a finer grid about it.
template <class T>
ShapeFound refined(const Search<T>& search, Bend bend) {
    constexpr std::array<double, 5> parts = {0.7, 0.85, 1.0, 1.15, 1.4};
    const double reach = 0.5 * search.family.width_px + AROUND_PX;
    const Strip strip = strip_along(search.picture, bent(search.axis, bend), reach, search.strips);
    Tried tried = {{}, {4, bend[1], FINE_TURN_RAD}, {2, bend[2], FINE_OFFSET_PX}, {2, bend[3], FINE_CLAMP_RAD}};
    for (const double part : parts) tried.contacts.push_back(bounded(bend[0] * part, LEAST_CONTACT, MOST_CONTACT));
    bend = best_of(search, Tabled(strip, 2, search.model.hidden), tried).bend;
    ShapeFound found = {0.0, bend, bent(search.axis, bend), {}};
    found.odds = odds_along(strip, found.path_px, search.model.hidden);
    found.evidence = search.evidence(total(found.odds) / search.axis.count, bend);
    return found;
}

// Strict order of two shapes, so that sorting does not depend on the library.
template <class Shape>
bool likelier(const Shape& a, const Shape& b) {
    return a.evidence > b.evidence || (a.evidence == b.evidence && a.bend < b.bend);
}

double mean_distance(const Table& one, const Table& other) {
    double sum = 0.0;
    for (int s = 0; s < one.shape[0]; ++s)
        sum += std::max(std::abs(one(s, 0) - other(s, 0)), std::abs(one(s, 1) - other(s, 1)));
    return sum / one.shape[0];
}

// The best shapes near rough paths, the best first, that are not all within the antenna's width from a better one.
template <class T>
std::vector<Bend> different(const Search<T>& search) {
    const ConstCube rough = search.family.rough_px;
    std::vector<Candidate> candidates;
    candidates.reserve(rough.shape[0]);
    for (int r = 0; r < rough.shape[0]; ++r) candidates.push_back(best_near(search, rough.row(r)));
    std::sort(candidates.begin(), candidates.end(), likelier<Candidate>);
    std::vector<Bend> found;
    std::vector<Table> paths;
    for (const Candidate& one : candidates) {
        Table path = bent(search.axis, one.bend);
        const auto alike = [&](const Table& other) { return mean_distance(path, other) < search.family.width_px; };
        if (std::any_of(paths.begin(), paths.end(), alike)) continue;
        found.push_back(one.bend);
        paths.push_back(std::move(path));
    }
    return found;
}

// Deviation of a pixel's noise in each channel, by second differences both ways at some thousands of places.
template <class T>
Colour noise_of(const Colours<T>& picture) {
    const auto [height, width, several] = picture.levels.shape;
    const int channels = picture.channels();
    const int step = std::max(1, static_cast<int>(std::sqrt(height * static_cast<double>(width) / NOISE_PLACES)));
    std::array<std::vector<float>, MOST_CHANNELS> found;
    for (int row = 1; row < height - 1; row += step)
        for (int column = 1; column < width - 1; column += step) {
            Colour sum = {};
            for (int v = -1; v <= 1; ++v)
                for (int u = -1; u <= 1; ++u) {
                    const T* const own = &picture.levels(row + v, column + u, 0);
                    const float weight = static_cast<float>((v ? 1 : -2) * (u ? 1 : -2));
                    for (int k = 0; k < channels; ++k) sum[k] += weight * static_cast<float>(own[k]);
                }
            const Colour off = picture.of(sum);
            for (int k = 0; k < channels; ++k) found[k].push_back(std::abs(off[k]) / 6.0f);
        }
    Colour noise = {};
    for (int k = 0; k < channels; ++k) {
        const auto middle = found[k].begin() + found[k].size() / 2;
        std::nth_element(found[k].begin(), middle, found[k].end());
        noise[k] = found[k].empty() ? 1.0f : *middle / 0.6745f + 0.3f;
    }
    return noise;
}

template <class T>
std::vector<ShapeFound> likely_in(const Colours<T>& picture, const ShapeFamily& family, ConstMatrix colours,
                                  const EdgeModel& model) {
    const Colour noise = noise_of(picture);
    const bool known = colours.shape[0] == LOOK_PLACES;
    const Looks looks = known ? looks_of(colours) : Looks{};
    const Looks* const own = known ? &looks : nullptr;
    const EdgeOdds odds(model.rate);
    const Search<T> search = {
        picture, family, axis_of(family.axis_px), {family.width_px, own, noise, model, odds}, model};
    std::vector<ShapeFound> found;
    for (const Bend& bend : different(search)) found.push_back(refined(search, bend));
    std::sort(found.begin(), found.end(), likelier<ShapeFound>);
    return found;
}

}  // namespace

std::vector<ShapeFound> likely_shapes(const Picture& picture, const ShapeFamily& family, ConstMatrix looks,
                                      const EdgeModel& model) {
    return std::visit(
        [&](const auto& levels) {
            using Kind = std::remove_const_t<std::remove_pointer_t<decltype(levels.data)>>;
            return likely_in(Colours<Kind>{levels}, family, looks, model);
        },
        picture);
}

}  // namespace vbaa::detect
