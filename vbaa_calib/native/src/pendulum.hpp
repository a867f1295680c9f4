// The elastica's universal curve: psi, C = integral of cos psi and S = integral of sin psi over v, of v and the
// friction angle alpha (vbaa_calib/antenna/elastica.py), by Taylor series and by Jacobi's functions.
//
// Below a = v^2 = 2.5 (68 degrees of slope at the contact if the force follows the normal, 51 if dead) the Taylor
// series in v^2 is faster and, for small loads, free of the cancellation that the closed form has. It converges for
// |v|^2 < K(1/2)^2 + K'(1/2)^2 = 6.875 whatever alpha, the distance to the nearest pole of the Jacobi functions.
#pragma once

#include <array>

#include "arrays.hpp"
#include "lanes.hpp"
#include "nodes.hpp"

namespace vbaa::antenna {

// Loads a = F l^2/EI up to which the series serves.
constexpr double SERIES_LOAD = 2.5;

// Halvings of the modulus, most: it vanishes even from 1 - m = 1e-12.
constexpr int LANDEN_STEPS = 9;

// Landen's descending chain for the parameter m.
struct Landen {
    struct Step {
        double half_gap, sine, cosine;
    };
    std::array<Step, LANDEN_STEPS> steps;
    int count;  // of those that matter
    double amplitude_scale, second_scale, m;
};
Landen landen(double m);

// Jacobi's functions of (u | m), and E(am(u | m) | m).
struct Jacobi {
    double sn, cn, dn, second;
};
Jacobi jacobi_at(double u, const Landen& chain);

struct UniversalPoint {
    double psi, along, across;
};
// The curve in closed form; the chain's m is (1 - sin alpha)/2.
UniversalPoint closed_form(double upsilon, double friction_rad, const Landen& chain);

// Write psi, C and S (3, B, N) at v (B, N), of which the first column is each row's largest, for angles (B,).
void universal_curve(ConstMatrix upsilon, ConstVector friction_rad, Cube curve);

// Sine and cosine of angles within +-pi/2, by their Taylor series.
struct SineCosine {
    Lanes sine, cosine;
};
SineCosine sine_and_cosine(Lanes angle_rad);

// The elastica's rotation at the nodes, seen from the contact: -sin psi, cos psi and theta' EI/(F l).
template <int COUNT>
struct HingeAt {
    std::array<Lanes, COUNT> sine, cosine, slope;
};
using Hinge = HingeAt<NODES>;
// Terms of the series for full precision up to this load.
int series_terms(double largest_load);
// Write the nodes before the contact by the series of so many terms.
void hinge_by_series(Lanes loads, SineCosine friction, int terms, Hinge& hinge);

}  // namespace vbaa::antenna
