#include "simulate_at_once.hpp"

#include <cmath>

#include "newton.hpp"

namespace vbaa::simulate {

namespace {

constexpr int DEPTHS = 12;

struct Frame {
    Point gravity_m_s2, core_m, depth_m;
    Rotation across;
    Point normal, axes[2];
};

// What is left of the seven equations, scaled. With a share below 1 the object is drawn back until only that share of
// the depth is left.
std::array<Lanes, 7> residual(const antenna::Rod& rod, const Pressing& pressing, const Frame& frame, double share,
                              const std::array<Lanes, 7>& x) {
    double length = rod.length_m, moment_unit = pressing.force_unit_N * length;
    Vectors normal = unit(x[5] * frame.axes[0] + x[6] * frame.axes[1] + frame.normal);
    Vectors moment = {moment_unit * x[0], moment_unit * x[1], moment_unit * x[2]};
    antenna::RodLoads loads = {frame.gravity_m_s2, pressing.force_unit_N * x[4] * normal, x[3] * length};
    antenna::Shots shots = antenna::shoot(rod, loads, moment, antenna::STEPS_PER_SEGMENT);
    Vectors in_plane = frame.across.turned(normal);
    Vectors away = frame.across.turned(shots.contact_m - frame.core_m + (1.0 - share) * frame.depth_m);
    Lanes reach = pressing.reach_m - pressing.compliance * x[4];
    if (!rod.slices.empty()) reach += pressing.antenna_radius_m * (antenna::diameter_at(rod, loads.contact_m) - 1.0);
    // along a line core the offset says nothing; there the normal's own component has to vanish
    Vectors gap = 1.0 / length * (away - reach * in_plane) + (normal - in_plane);
    Vectors tip = 1.0 / moment_unit * shots.tip_moment_Nm;
    Lanes inside = -dot(normal, shots.tangent), before_tip = 1.0 - x[3];
    return {tip.x, tip.y, tip.z, gap.x, gap.y, gap.z, where_positive(inside - before_tip, before_tip, inside)};
}

}  // namespace

int touch_at_once(const antenna::Rod& rod, const Pressing& pressing, ConstCube frames, ConstCube limits, Matrix x) {
    for (int i = 0; i < x.shape[0]; ++i) {
        Frame frame = read<Frame>(&frames(i, 0, 0));
        auto low = read<Numbers<7>>(&limits(i, 0, 0)), high = read<Numbers<7>>(&limits(i, 1, 0));
        auto state = read<Numbers<7>>(&x(i, 0)), start = state;
        auto left = [&](double share) {
            auto at = [&](const std::array<Lanes, 7>& trial) { return residual(rod, pressing, frame, share, trial); };
            return newton<7>(at, state, low, high, pressing.tolerance);
        };
        double size = left(1.0);
        if (!(size <= pressing.tolerance)) {
            // pushed in by and by
            auto share = [](int step) { return std::pow(double(step) / DEPTHS, 1.5); };
            state = start;
            state[4] *= share(1);
            for (int step = 1; step <= DEPTHS; ++step) size = left(share(step));
        }
        write(state, &x(i, 0));
        if (!(size <= pressing.tolerance)) return i;
    }
    return -1;
}

}  // namespace vbaa::simulate
