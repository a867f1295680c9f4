// How stiffness and weight change along an antenna that is not uniform, relative to its clamp's.
//
// Pieces, between which they may jump; on each the diameter is linear in the arc length, and so is a root of the
// stiffness: the fourth where it follows from the diameter, the first where it is known itself. Places are in antenna
// lengths.
#pragma once

#include "arrays.hpp"
#include "nodes.hpp"

namespace vbaa::antenna {

struct Panel {
    double start, end;
    double diameter, diameter_slope;  // at the start, and along it
    double root, root_slope;
    int power;
};

// Integrals from the clamp to a place, per flexibility c there: of c, c·x, c·x², and of c and c·x times the moment of
// the weight beyond, that of a uniform antenna's weight being one per length.
struct Integrals {
    double c, cx, cxx, weighed, weighed_x;
};

struct Taper {
    // Pieces are (P, 7): start, end, diameter at both, root of the stiffness at both, and which root; they are divided
    // into panels until a polynomial on the nodes of each describes its flexibility.
    static constexpr int PIECES = 24, PANELS = 32;

    int count = 0;  // of panels; 0: the antenna is uniform
    std::array<Panel, PANELS> panels;
    double weight = 1.0, weight_moment = 0.5;  // of all, and at the clamp, for a uniform antenna's weight of one
    std::array<std::array<Integrals, NodeTables::PANEL + 1>, PANELS>
        series;  // by powers of x from −1 to 1 on each panel

    explicit operator bool() const { return count > 0; }
};

// The taper of pieces (P, 7) that follow each other from 0 to 1; none: uniform.
Taper taper_of(ConstMatrix pieces);

// Whether these pieces are sound: in order, all numbers positive, and few enough.
bool sound_taper(ConstMatrix pieces);

Integrals integrals_at(const Taper& taper, double place);

// Flexibility 1/EI and diameter on a panel, relative to the clamp's, at a place that is kept on it.
template <class T>
T flexibility(const Panel& panel, T place) {
    const T root = T(panel.root) + panel.root_slope * (place - panel.start);
    if (panel.power == 1) return 1.0 / root;
    const T square = root * root;
    return 1.0 / (square * square);
}
template <class T>
T weight_at(const Panel& panel, T place) {
    const T diameter = T(panel.diameter) + panel.diameter_slope * (place - panel.start);
    return diameter * diameter;
}
// Weight per length at a place, over a uniform antenna's.
double weight_at(const Taper& taper, double place);

// Small deflection at a place, and slope there, of a unit force at another, for a clamp of unit stiffness: Eq. (1),
// (2).
inline double deflection(const Taper& taper, double along, double contact) {
    const double near = along < contact ? along : contact, far = along < contact ? contact : along;
    if (!taper) return (3.0 * far - near) * near * near / 6.0;
    const Integrals at = integrals_at(taper, near);
    return along * contact * at.c - (along + contact) * at.cx + at.cxx;
}
// Derivative of that deflection by the contact's place.
inline double deflection_by_contact(const Taper& taper, double along, double contact) {
    const double near = along < contact ? along : contact;
    if (!taper) return 0.5 * near * (2.0 * along - near);
    const Integrals at = integrals_at(taper, near);
    return along * at.c - at.cx;
}

}  // namespace vbaa::antenna
