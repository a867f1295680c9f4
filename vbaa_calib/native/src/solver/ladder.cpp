#include "solver/ladder.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "solver/convergence.hpp"
#include "solver/initialization.hpp"
#include "solver/normal_equations.hpp"
#include "solver/prediction.hpp"

namespace vbaa::solver {
namespace {

// Approximate number of a frame's points with which minima are searched.
constexpr int COARSE_POINTS = 64;
// A larger scatter, or a friction angle of more σ, is a reason to search elsewhere.
constexpr double LOST_SCATTER = 2.0, LOST_FRICTION = 2.5;
// Below this gain over the free antenna neither distance nor other minima are searched: contact takes three times as
// much.
constexpr double FAINT = 5.0;
// Without a force of so many σ in any direction the mirror image of a contact does not matter.
constexpr double SIGNIFICANT_FORCE = 3.0;
// A minimum that costs this many times the lowest one, and this much more, is dropped.
constexpr double HOPELESS = 50.0, HOPELESS_FACTOR = 4.0;

// State of the search for one frame: its inputs, and rough minima, lowest first, with infinite cost where there is
// none.
struct Search {
    const Rig &rig, &exact;
    const Frame& frame;
    Thinned some;  // of its points
    Work& work;
    Task few;  // the same with these, on the rough rig, for rough minima
    Grid grid;
    Starts starts;
    StartCosts costs;
    std::array<Fit*, STARTS> rough;  // minima, in the room of the few points
};

// Replaces starts by the rough minima that they lead to on a rung, lowest first, and their costs. Minima that another
// start reached too, and hopeless ones, come out with infinite cost.
void coarse_minima(Search& search) {
    for (int k = 0; k < STARTS; ++k) {
        const Unknowns& start = search.starts[k];
        const bool finite = std::all_of(start.begin(), start.end(), [](double each) { return std::isfinite(each); });
        const double cost = std::exchange(search.costs[k], INFINITE);
        if (!std::isfinite(cost) || !finite) continue;
        Fit& fit = *search.rough[k];
        // feet near the right ones
        for (int i = 0; i < fit.points; ++i) {
            fit.foot_m[i] = search.work.free.foot_m[search.some.middle(i, search.frame.count)];
        }
        if (rough_minimum(search.few, start, true, fit)) search.costs[k] = fit.cost;
        search.starts[k] = fit.unknowns;
    }
    for (int a = 0; a < STARTS - 1; ++a) {
        for (int b = a + 1; b < STARTS; ++b) {
            if (!(search.costs[b] < search.costs[a])) continue;
            std::swap(search.costs[a], search.costs[b]);
            std::swap(search.starts[a], search.starts[b]);
            std::swap(search.rough[a], search.rough[b]);
        }
    }
    for (int k = 1; k < STARTS; ++k) {
        const bool apart = different(search.starts[k], search.starts[0]);
        if (!(apart && search.costs[k] < HOPELESS_FACTOR * search.costs[0] + HOPELESS)) search.costs[k] = INFINITE;
    }
}

// Memory for a frame's search, reused for the next one where sizes agree, as most do.
class Room {
  public:
    Work& of(const Rig& rig, int points) {
        if (!work || !fits(rig, points)) work = std::make_unique<Work>(rig, points);
        return *work;
    }

  private:
    bool fits(const Rig& rig, int points) const {
        const Fit& fit = work->best;
        const Array<double, 2>& axes = work->bent.axes;
        if (fit.points != points || fit.nodes != rig.nodes() || fit.size != UNKNOWNS + rig.steps() ||
            fit.readings != rig.readings)
            return false;
        if (axes.shape[0] != rig.axes.shape[0] || axes.shape[1] != whole_lanes(UNKNOWNS + rig.shared)) return false;
        for (int q = 0; q < axes.shape[0]; ++q) {
            const double* own = rig.axes.row(q).begin();
            if (!std::equal(own, own + rig.shared, &axes(q, UNKNOWNS))) return false;
        }
        return true;
    }

    std::unique_ptr<Work> work;
};

// Rough minima on a rung, and the free antenna. `warm`, unknowns near the truth where finite, may take their place.
// Without `always` a frame that may be free keeps the starts.
Search begun(const Task& task, const Rigs& rigs, const Unknowns& warm, bool always, Room& room) {
    const auto& [rig, frame, rung, work] = task;
    free_antenna(rig, frame, work.free, work);
    Thinned some = thinned(frame, COARSE_POINTS);
    Work& rough = room.of(rigs.rough, some.frame.count);
    Search search = {rig,   rigs.exact,
                     frame, std::move(some),
                     work,  {rigs.rough, search.some.frame, rung, rough},
                     {},    {},
                     {},    {&rough.best, &rough.found}};
    few_of_free(search.few, search.some, work.free, rough.free);
    // as of single points: the linear beam does not fit better than they
    search.grid = grid_search(rigs.rough, search.some.frame, rough.free, 1.0 / search.some.every, rough);
    lowest_of_grid(rig, search.grid, search.starts, search.costs);
    if (always || largest_gain(search.grid) > FAINT) {
        warm_start(search.grid, warm, search.starts, search.costs);
        coarse_minima(search);
    }
    return search;
}

// Distance of most points from the nearest antenna, with its unknowns in `nearest`, for a frame that no contact
// explains; else NaN.
double left_over(const Search& search, Unknowns& nearest) {
    const Rig& rig = search.rig;
    const Fit& free = search.work.free;
    const int every = search.some.every;
    const LargestError error = largest_error(rig, free, every);
    nearest = search.starts[0];
    double left = beyond_reach(rig, search.some.frame);
    if (!(left > error.far)) {
        left = most_distance(rig, search.frame, free, every, search.grid.shift);
        if (left > error.far) {
            left = nearest_shape(search.exact, search.some.frame, search.grid, search.starts[0], error, nearest);
        }
    }
    return left > error.far ? left : NOT_KNOWN;
}

bool is_lost(const Fit& fit) {
    return !fit.converged || fit.scatter > LOST_SCATTER || std::abs(fit.unknowns[UNKNOWNS - 1]) > LOST_FRICTION;
}

// Searches a lost frame again: with new feet, and from the picture alone on the exact rig.
void search_lost(const Search& search, int rung, Alternative& other) {
    const Rig& rig = search.rig;
    Work& work = search.work;
    Fit& best = work.best;
    if (!is_lost(best)) return;
    const Task task = {rig, search.frame, rung, work};
    try_start(task, best.unknowns, nullptr, best, other);
    if (!is_lost(best)) return;
    begin_search(work);
    Unknowns start;
    const double scatter = largest_error(rig, work.free, search.some.every).scatter;
    nearest_shape(search.exact, search.some.frame, search.grid, best.unknowns, {0.0, scatter}, start);
    try_start(task, start, nullptr, best, other);
}

// Whether the force stands out of its uncertainty in some direction across the antenna.
bool is_significant(const Unknowns& unknowns, const Uncertainty& found) {
    const double first = unknowns[1], second = unknowns[2];
    const double own = found.covariance[1][1], cross = found.covariance[1][2], opposite = found.covariance[2][2];
    const double apart = opposite * first * first - 2.0 * cross * first * second + own * second * second;
    return apart > SIGNIFICANT_FORCE * SIGNIFICANT_FORCE * (own * opposite - cross * cross);
}

// Feet near the right ones: the free antenna's, shifted as those of the rough minimum were.
void near_feet(const Search& search, Fit& fit) {
    fit.foot_m = search.work.free.foot_m;
    const Array<double, 1>&rough_m = search.rough[0]->foot_m, &free_m = search.work.free.foot_m;
    const Array<int, 1>& picture = search.some.frame.clamp;
    const int every = search.some.every, last = search.some.frame.count - 1;
    const auto shift = [&](int k) { return rough_m[k] - free_m[search.some.middle(k, search.frame.count)]; };
    for (int k = 0, i = 0; k <= last; ++k) {
        const bool followed = k < last && picture[k + 1] == picture[k];
        const double here = shift(k), apart = followed ? (shift(k + 1) - here) / every : 0.0;
        for (const int begin = i; i < std::min(begin + every, fit.points); ++i)
            fit.foot_m[i] += here + (i - begin) * apart;
    }
}

// The best of a frame's minima on a rung and its uncertainty, unless the former alone are asked for to first order;
// whether its mirror image looks like it.
bool fit_on_rung(const Search& search, int rung, bool minima_only, Uncertainty& found, Alternative& other,
                 Marginal& marginal) {
    const Rig& rig = search.rig;
    const Frame& frame = search.frame;
    Work& work = search.work;
    Fit& best = work.best;
    const bool distinct = largest_gain(search.grid) > FAINT;
    best.unknowns = search.starts[0];
    const Fit* rough = distinct && search.rough[0]->cost == search.rough[0]->cost ? search.rough[0] : nullptr;
    if (rough != nullptr) {
        near_feet(search, best);
    } else {
        best.foot_m = work.free.foot_m;
    }
    const Task task = {rig, frame, rung, work};
    if (distinct || !converge_there(rig, frame, rung, best, work)) converge(task, rough, best, true);
    other = {best.unknowns, INFINITE};
    if (distinct) {
        for (int k = 1; k < STARTS; ++k) {
            if (!std::isfinite(search.costs[k])) continue;
            try_start(task, search.starts[k], search.rough[k], best, other);
        }
        search_lost(search, rung, other);
    }
    uncertainty(best, found, work);
    const bool ambiguous = is_significant(best.unknowns, found) && mirror_ambiguous(rig, frame, best, found);
    if (ambiguous && best.converged && best.scatter <= WRONG_SHAPE) {
        const Unknowns before = best.unknowns;
        try_mirrors(task, search.few, found, best, other);
        uncertainty(best, found, work);
        if (different(before, best.unknowns)) {
            // a better minimum has a mirror image of its own
            try_mirrors(task, search.few, found, best, other);
            uncertainty(best, found, work);
        }
        if (minima_only) return ambiguous;
        const double least = MarginalSettings().worthless;
        bool read = false;
        for (int k = 0; k < rig.readings; ++k) read = read || (k != END && frame.available[k] > least);
        if (!read && best.converged) marginalise(task, best, other, found, marginal);
        if (!marginal.known) widen_by_profile(rig, frame, rung, best, found, work);
    }
    return ambiguous;
}

// The fit with the residuals of the highest rung, which has the exact shapes.
Fit& with_right_shapes(const Search& search, int rung) {
    Work& work = search.work;
    if (rung == REFERENCE) return work.best;
    work.found = work.best;
    predict(search.rig, search.frame, REFERENCE, work.bent, work.found, false);
    linearise(search.rig, search.frame, work.found, work);
    points_cost(work.found);
    return work.found;
}

// Bias of each rung, and the lowest rung that is good enough.
void judge_rungs(const Search& search, int model, const Fit& problem, const Uncertainty& found, Findings& findings) {
    if (model == REFERENCE) return;
    double bias[REFERENCE + 1];
    first_order_errors({search.rig, search.frame, findings.rung, search.work}, search.work.best, problem,
                       findings.errors);
    predicted_bias(findings.errors, found, bias);
    if (model == AUTO) {
        std::copy_n(bias, REFERENCE + 1, findings.bias);
        findings.needed = 0;
        while (findings.needed < REFERENCE && !(bias[findings.needed] <= SMALL_BIAS)) ++findings.needed;
    } else {
        findings.bias[findings.rung] = bias[findings.rung];
    }
}

// One frame on a rung, by default on the highest: then also which one would have been good enough.
void solve_frame(const Task& asked, const Rigs& rigs, const Unknowns& warm, const Demand& demand, Numbers& numbers,
                 Room& room) {
    const auto& [rig, frame, model, work] = asked;
    const int rung = model == AUTO ? REFERENCE : model;
    const Task task = {rig, frame, rung, work};
    const Search search = begun({rig, frame, std::min<int>(rung, ELASTICA), work}, rigs, warm, false, room);
    Uncertainty found(rig.steps());
    Findings findings;
    findings.rung = findings.needed = rung;
    std::fill_n(findings.bias, REFERENCE + 1, NOT_KNOWN);
    const double left = left_over(search, findings.other.unknowns);
    const bool ended = std::isfinite(left);
    if (ended) {
        work.best.unknowns = findings.other.unknowns;
        findings.other.cost = INFINITE;
        coarse_minimum(task, work.best, false, MOST_SCATTER, 0);
        uncertainty(work.best, found, work);
    } else {
        findings.ambiguous = fit_on_rung(search, rung, demand.minima_only, found, findings.other, findings.marginal);
    }
    const Fit& problem = with_right_shapes(search, rung);
    judge_rungs(search, model, problem, found, findings);
    findings.evidence = NOT_KNOWN;
    if (!ended) {
        const double distance_std = std::sqrt(found.covariance[0][0]);
        findings.second = second_force(task, work.best, problem, distance_std);
        findings.evidence = contact_evidence(task, search.few, work.best, problem);
    }
    findings.other.cost -= unscaled_cost(rig, work.best);
    findings.left_px = rig.cameras[frame.seen_by].focal * left;
    write_numbers(task, found, findings, demand.pieces_m, numbers);
}

}  // namespace

template <class Measured>
void solve_frames(const Rigs& rigs, const Measured& frames, const Demand& demand, View<Numbers, 1> numbers) {
    const ConstMatrix& warm = demand.warm;
    thread_local Room room, few;  // a call with one frame would take longer to make them than for all else
    Unknowns start;
    start.fill(NOT_KNOWN);
    FreeShapes free;
    for (int index = demand.begin; index < demand.end; ++index) {
        Frame frame = frame_of(rigs.exact, frames, index);
        frame.lane = index % LANES;
        frame.free = &free;
        if (frame.lane == 0 || index == demand.begin) {
            // the same frames together whatever part of all is asked for
            const int first = index - frame.lane, some = std::min(LANES, frames.size() - first);
            free.rig = &rigs.exact;
            free.gravity_m_s2 = frames.gravity_m_s2.part(first, some);
            free.bent = false;
        }
        if (frame.count < PointSettings().fewest) {
            numbers[index].points = frame.count;
            continue;
        }
        const Rig& rig = information_of(frame) > rigs.usual.most_information ? rigs.complete : rigs.usual;
        Work& work = room.of(rig, frame.count);
        work.evaluations = work.most = 0;
        begin_search(work);
        if (warm.size()) std::copy_n(warm.row(index).data, UNKNOWNS, start.begin());
        solve_frame({rig, frame, demand.rung, work}, rigs, start, demand, numbers[index], few);
    }
}

template void solve_frames(const Rigs&, const Frames&, const Demand&, View<Numbers, 1>);
template void solve_frames(const Rigs&, const Pixels&, const Demand&, View<Numbers, 1>);

void rough_frames(const Rig& rig, const Frames& frames, Matrix unknowns, Cube points_m) {
    Unknowns warm;
    warm.fill(NOT_KNOWN);
    for (int index = 0; index < frames.size(); ++index) {
        const Frame frame = frame_of(rig, frames, index);
        Work work(rig, frame.count);
        Room few;
        const Search search = begun({rig, frame, LINEAR, work}, {rig, rig, rig, rig}, warm, true, few);
        work.best.unknowns = search.starts[0];
        std::copy_n(search.starts[0].begin(), UNKNOWNS, unknowns.row(index).data);
        predict(rig, frame, LINEAR, work.bent, work.best, false);
        for (int j = 0; j < NODES; ++j) {
            for (int axis = 0; axis < 3; ++axis) points_m(index, j, axis) = work.best.points_m[axis][j];
        }
    }
}

}  // namespace vbaa::solver
