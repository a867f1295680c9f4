#include "simulate_stick_slip.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "newton.hpp"

namespace vbaa::simulate {

namespace {

constexpr double GRIP_TOLERANCE = 1e-8;  // on the grip in EI/L²
// Stiffness K of a sticking contact in EI/L³: 28 kN/m for the steel whisker, itself a spring of 3 N/m at its tip
constexpr double STICK = 1e5;
constexpr int DOUBLINGS = 60, BISECTIONS = 60, ITERATIONS = 20;
constexpr double ROOM = 0.3;  // of the contact's place in one step, in L

// x: M(0) in EI/L, s in L, N in EI/L², change of p in L, and g in EI/L² along the axes.
constexpr int UNKNOWNS = 10, SMOOTH = 8;
using State = Numbers<UNKNOWNS>;

// As `Held` packs it.
struct Held {
    Point moment_Nm;
    double arclength_m, press_N;
    Point grip_N, place_m, normal, point_m, tangent, slipped_m;
};

struct Frame {
    Rotation R_world_antenna;
    Point origin_m, gravity_m_s2, axes[2];
};

// Vectors in the world frame.
struct Step {
    antenna::Rod rod;
    Object object;
    Touching touching;
    Frame frame;
    Held before, start;
};

// Contacts of eight trials.
struct Trials {
    Vectors moment_Nm;
    Lanes arclength_m, press_N;
    Vectors grip_N, place_m, normal, point_m, tangent, way_m, axes[2], tip_moment_Nm;
    Lanes gap_m;  // from the centreline's required position to the place
};

// Distances and normals at eight places, most of which repeat the first.
Lanes distances(const Object& object, const Vectors& places, Vectors& normals) {
    Lanes found;
    Surface first = {};
    for (int i = 0; i < LANES; ++i) {
        Point place = lane(places, i);
        bool same = i > 0 && place.x == places.x[0] && place.y == places.y[0] && place.z == places.z[0];
        Surface here = same ? first : signed_distance(object, place);
        if (i == 0) first = here;
        found[i] = here.distance_m;
        set_lane(normals, i, here.normal);
    }
    return found;
}

Trials tried(const Step& step, const std::array<Lanes, UNKNOWNS>& x) {
    const Frame& frame = step.frame;
    double length = step.rod.length_m, force_unit = step.touching.force_unit_N;
    Point old = step.start.normal;
    Trials trials;
    trials.press_N = force_unit * x[4];
    trials.arclength_m = length * x[3];
    trials.place_m = Vectors{length * x[5], length * x[6], length * x[7]} + step.start.place_m;
    trials.gap_m = distances(step.object, trials.place_m, trials.normal) -
                   step.touching.antenna_radius_m * antenna::diameter_at(step.rod, trials.arclength_m);
    // the axes turn with the normal; in them the grip stays as it is
    for (int i = 0; i < 2; ++i) {
        Lanes share = -dot(trials.normal, frame.axes[i]) / (1.0 + dot(trials.normal, old));
        trials.axes[i] = share * (trials.normal + old) + frame.axes[i];
    }
    trials.grip_N = force_unit * (x[8] * trials.axes[0] + x[9] * trials.axes[1]);
    const Rotation& turn = frame.R_world_antenna;
    antenna::RodLoads loads = {turn.turned_back(frame.gravity_m_s2),
                               turn.turned_back(trials.grip_N + trials.press_N * trials.normal), trials.arclength_m};
    double moment_unit = force_unit * length;
    trials.moment_Nm = {moment_unit * x[0], moment_unit * x[1], moment_unit * x[2]};
    antenna::Shots shots = antenna::shoot(step.rod, loads, trials.moment_Nm, antenna::STEPS_PER_SEGMENT);
    trials.tip_moment_Nm = shots.tip_moment_Nm;
    trials.point_m = turn.turned(shots.contact_m) + frame.origin_m;
    trials.tangent = turn.turned(shots.tangent);
    Vectors run = unit(trials.tangent + step.before.tangent);
    Vectors way = trials.point_m - step.before.point_m + (step.before.arclength_m - trials.arclength_m) * run;
    trials.way_m = way - dot(way, trials.normal) * trials.normal;
    return trials;
}

// Scaled residuals of the smooth equations, and the slip Δu along both axes in antenna lengths.
std::array<Lanes, UNKNOWNS> residual(const Step& step, const std::array<Lanes, UNKNOWNS>& x) {
    Trials trials = tried(step, x);
    double length = step.rod.length_m;
    Vectors tip = 1.0 / (step.touching.force_unit_N * length) * trials.tip_moment_Nm;
    Vectors indented = trials.press_N * step.touching.compliance_m_N * trials.normal;
    Vectors apart = 1.0 / length * (trials.point_m - trials.place_m + indented);
    Lanes inside = -dot(trials.normal, trials.tangent), before_tip = 1.0 - x[3];
    std::array<Lanes, UNKNOWNS> left;
    set(left, 0, tip);
    set(left, 3, apart);
    left[6] = trials.gap_m / length;
    left[7] = where_positive(inside - before_tip, before_tip, inside);
    for (int i = 0; i < 2; ++i) left[SMOOTH + i] = dot(trials.axes[i], trials.way_m) / length;
    return left;
}

// The step: the linearised rest keeps the law of friction exactly; zero where that is not finite.
State newton_step(const State& x, const Linearised<UNKNOWNS, UNKNOWNS>& at, Pair grip, double friction) {
    // of the unknowns other than the grip: the first column without a change of the grip, the others with one
    Small<SMOOTH, SMOOTH> matrix;
    Small<SMOOTH, 3> solved;
    for (int i = 0; i < SMOOTH; ++i) {
        for (int j = 0; j < SMOOTH; ++j) matrix[i][j] = at.slopes[i][j];
        solved[i] = {-at.values[i], -at.slopes[i][8], -at.slopes[i][9]};
    }
    State move = {};
    if (!solve<SMOOTH, 3>(matrix, solved)) return move;
    auto along = [&](int axis, double before, Pair& spring) {
        double way = at.values[SMOOTH + axis];
        spring = {at.slopes[SMOOTH + axis][8], at.slopes[SMOOTH + axis][9]};
        for (int j = 0; j < SMOOTH; ++j) {
            way += at.slopes[SMOOTH + axis][j] * solved[j][0];
            spring.first += at.slopes[SMOOTH + axis][j] * solved[j][1];
            spring.second += at.slopes[SMOOTH + axis][j] * solved[j][2];
        }
        spring = {STICK * spring.first, STICK * spring.second};
        return before - STICK * way + spring.first * x[8] + spring.second * x[9];
    };
    GripLaw law = {{x[8], x[9]}, {}, {}, x[4] + solved[4][0], {solved[4][1], solved[4][2]}, friction};
    law.pull = {along(0, grip.first, law.spring[0]), along(1, grip.second, law.spring[1])};
    Pair found = gripped(law);
    move[8] = found.first - x[8];
    move[9] = found.second - x[9];
    for (int i = 0; i < SMOOTH; ++i) move[i] = solved[i][0] + solved[i][1] * move[8] + solved[i][2] * move[9];
    return move;
}

// Keep the step within the rod, and not far from where the search began.
void take(State& x, State& move) {
    double steep = 50.0 / std::min(std::max(x[3], 0.05), 1.0);
    for (int i = 0; i < UNKNOWNS; ++i) {
        double most = i < 3 ? steep : i == 3 ? 1.0 : i >= 5 && i < 8 ? ROOM : 20.0 * steep;
        double limited = std::min(std::max(x[i] + move[i], i == 3 ? 0.01 : -most), most);
        move[i] = limited - x[i];
        x[i] = limited;
    }
}

// Newton's method from x, which is overwritten; `grip` is the one before the step, in EI/L².
bool found(const Step& step, State& x, Pair grip) {
    const double tolerance = step.touching.tolerance, infinity = std::numeric_limits<double>::infinity();
    State move = {};
    double size = infinity;
    auto left = [&](const std::array<Lanes, UNKNOWNS>& trial) { return residual(step, trial); };
    for (int iteration = 0; iteration < ITERATIONS; ++iteration) {
        auto at = linearised<UNKNOWNS, UNKNOWNS>(left, x);
        double now = largest(read<Numbers<SMOOTH>>(at.values.data()));
        if (!std::isfinite(largest(at.slopes))) now = infinity;
        if (now > std::max(2.0 * size, 1e3 * tolerance)) {
            for (int i = 0; i < UNKNOWNS; ++i) x[i] -= move[i] *= 0.5;
            continue;
        }
        size = now;
        move = newton_step(x, at, grip, step.touching.friction);
        if (size <= tolerance && std::max(std::abs(move[8]), std::abs(move[9])) <= GRIP_TOLERANCE) return true;
        take(x, move);
    }
    return false;
}

// The grip for a λ, see gripped.
Pair grip_at(double share, const GripLaw& law) {
    double a = share + law.spring[0].first, b = law.spring[0].second;
    double c = law.spring[1].first, d = share + law.spring[1].second, determinant = a * d - b * c;
    return {(d * law.pull.first - b * law.pull.second) / determinant,
            (a * law.pull.second - c * law.pull.first) / determinant};
}

// Whether the grip for a λ is too long.
bool beyond_rim(double share, const GripLaw& law) {
    auto [y, z] = grip_at(share, law);
    double press = law.press + law.lift.first * (y - law.now.first) + law.lift.second * (z - law.now.second);
    return std::hypot(y, z) - law.friction * std::max(press, 0.0) > 0.0;
}

}  // namespace

Advanced advance(const antenna::Rod& rod, const Object& object, const Touching& touching, ConstCube frames,
                 ConstCube ends) {
    int count = frames.shape[0];
    double length = rod.length_m, force_unit = touching.force_unit_N, moment_unit = force_unit * length;
    Advanced advanced = {Array<double, 2>(count, int(sizeof(Held) / sizeof(double))), Array<std::uint8_t, 1>(count)};
    for (int b = 0; b < count; ++b) {
        Step step = {rod,
                     object,
                     touching,
                     read<Frame>(&frames(b, 0, 0)),
                     read<Held>(&ends(b, 0, 0)),
                     read<Held>(&ends(b, 1, 0))};
        const Held& start = step.start;
        auto in_axes = [&](const Point& force) {
            return Pair{dot(step.frame.axes[0], force) / force_unit, dot(step.frame.axes[1], force) / force_unit};
        };
        Pair grip = in_axes(step.before.grip_N), begun = in_axes(start.grip_N);
        State x = {};
        set(x, 0, 1.0 / moment_unit * start.moment_Nm);
        x[3] = start.arclength_m / length;
        x[4] = start.press_N / force_unit;
        x[8] = begun.first;
        x[9] = begun.second;
        advanced.good[b] = found(step, x, grip);
        std::array<Lanes, UNKNOWNS> last;
        for (int i = 0; i < UNKNOWNS; ++i) last[i] = spread(x[i]);
        Trials at = tried(step, last);
        // the deflection of the grip's own spring is slip, too
        Point give = (x[8] - grip.first) * lane(at.axes[0], 0) + (x[9] - grip.second) * lane(at.axes[1], 0);
        Held held = {lane(at.moment_Nm, 0), at.arclength_m[0],   at.press_N[0],
                     lane(at.grip_N, 0),    lane(at.place_m, 0), lane(at.normal, 0),
                     lane(at.point_m, 0),   lane(at.tangent, 0), lane(at.way_m, 0) + length / STICK * give};
        write(held, &advanced.held(b, 0));
    }
    return advanced;
}

// With λ g = g before − K Δu, the grip is (λ + spring)⁻¹ pull: λ = 1 sticks, and a slide has the λ > 1 that puts g on
// the rim.
Pair gripped(const GripLaw& law) {
    if (law.friction == 0.0) return {0.0, 0.0};
    double low = 1.0, high = 1.0;
    if (!beyond_rim(low, law)) return grip_at(low, law);
    for (int doubling = 0; doubling < DOUBLINGS && beyond_rim(high, law); ++doubling) {
        low = high;
        high *= 4.0;
    }
    for (int bisection = 0; bisection < BISECTIONS; ++bisection) {
        double middle = std::sqrt(low * high);
        (beyond_rim(middle, law) ? low : high) = middle;
    }
    return grip_at(high, law);
}

}  // namespace vbaa::simulate
