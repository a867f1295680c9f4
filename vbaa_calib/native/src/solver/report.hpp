// The report on fitted frames: a status each, and the numbers that the data support.
#pragma once

#include <cstdint>

#include "solver/numbers.hpp"

namespace vbaa::solver {

// Statuses, in Python's order.
enum class Status : std::int64_t { NO_ANTENNA, FAILED, NO_CONTACT, UNOBSERVABLE, LOW, AT_TIP, OK };

// What was noticed of a fit, one bit each.
enum Noticed : std::uint64_t {
    MIRRORED = 1,           // vision is alone, and only perspective separates the contact from its mirror image
    AT_CLAMP = 2,           // it lies at the least distance that is searched
    TOO_STEEP = 4,          // friction cannot be as large
    TWICE_TOUCHED = 8,      // a second force explains so much more that the distance cannot be believed
    UNEXPLAINED = 16,       // no one contact, as contacts are thought possible, explains the frame
    MODEL_TOO_LOW = 32,     // the requested model's bias exceeds what its deviations can include
    FORCE_UNKNOWN = 64,     // the force is undetermined in some direction, and the contact point with it
    OUT_OF_ORDINARY = 128,  // there is something to remark about a contact that is ok
    DOUBTED = 256           // points or the end lie off, or neither a contact nor the free antenna explains the frame
};

// `ContactSettings` in Python, by the same names.
struct Limits {
    double contact_evidence, edge_on_rad, edge_on_blind_rad, low_signal, low_signal_relative, alternative_cost;
    double steepest, steepest_blind, second_contact, second_shift, highest_bias, contradiction, disagreement;
    double friction_share, outlying_std, jump, outlying_end;
    int fewest_points;
};

// Statuses (B,) as Status: the first that applies, from what makes all else meaningless to what can be trusted; and
// what was noticed (B,).
struct Judged {
    View<std::int64_t, 1> status;
    View<std::uint64_t, 1> noticed;
};
void judge(View<const Numbers, 1> numbers, const Limits& limits, const Judged& found);

// How the antenna frame stands in the world (B, 3, 3), (B, 3), and what the fits' units are.
struct Placed {
    ConstCube rotation;
    ConstMatrix translation_m;
    double length_m, friction_rad, moment_Nm;
};

// Columns of `Contacts` in Python, by the same names; NaN where the data do not support a number.
struct Reported {
    double distance_m, distance_std_m, distance_shared_std_m, force_covariance_yz_N2, moment_residual_Nm;
    double friction_angle_rad, friction_angle_std_rad, evidence;
    double point_shared_std_m[3], force_shared_std_N[3], force_N[3], force_std_N[3], deflection_m[3];
    double point_antenna_m[3], point_world_m[3], force_world_N[3], tangent_world[3], covariance_world_m2[3][3];
    bool in_contact;
};
void report(View<const Numbers, 1> numbers, const Judged& judged, const Placed& placed, View<Reported, 1> rows);

}  // namespace vbaa::solver
