// One step of antennas that are pressed against an object with Coulomb friction;
// vbaa_calib/simulate/contact/stick_slip.py has the equations.
#pragma once

#include <cstdint>

#include "arrays.hpp"
#include "shooting.hpp"
#include "simulate_objects.hpp"

namespace vbaa::simulate {

struct Touching {
    double antenna_radius_m;  // at its clamp
    double compliance_m_N;    // the object's
    double force_unit_N;      // EI/L²
    double friction;          // coefficient
    double tolerance;         // on lengths in L, moments in EI/L and n·t
};

// B contacts (B, 23) as `Held` packs them, and which were found.
struct Advanced {
    Array<double, 2> held;
    Array<std::uint8_t, 1> good;
};
// frames: (B, 7, 3) R_world_antenna, the antenna frame's origin, gravity, and two axes across the normal at the start.
// ends: (B, 2, 23) the contact before the step, and where the search begins.
Advanced advance(const antenna::Rod& rod, const Object& object, const Touching& touching, ConstCube frames,
                 ConstCube ends);

// Two components along the axes across a contact's normal.
struct Pair {
    double first, second;
};

// Linearisation about a grip `now`, in consistent units: slip Δu = way + give·(g − now), normal force press + lift·(g −
// now).
struct GripLaw {
    Pair now, pull;  // pull: g before − K way + K give·now
    Pair spring[2];  // K give
    double press;
    Pair lift;
    double friction;  // coefficient
};
// The grip g = limited(g before − K Δu), where limited() cuts its length off at friction times the normal force.
Pair gripped(const GripLaw& law);

}  // namespace vbaa::simulate
