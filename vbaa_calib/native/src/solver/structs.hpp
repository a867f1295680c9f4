// Data of a frame's fit: rig, frame, fit, uncertainty and scratch room.
#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "arrays.hpp"
#include "lanes.hpp"
#include "shapes.hpp"

namespace vbaa::lens {
struct Lens;
}

namespace vbaa::solver {

using antenna::CONTACT, antenna::NODES_BEYOND, antenna::NODES_TO_CONTACT;
using antenna::PAPER, antenna::LINEAR, antenna::ELASTICA, antenna::ROD;  // shapes from ELASTICA on depend on friction

// Distance in antenna lengths, force along y and z of the clamp's frame in the rig's unit, friction angle in σ.
constexpr int UNKNOWNS = 4;
constexpr int POSES = 6, ANTENNA = 9;                          // parameters of the camera's pose and of the antenna
constexpr int NODES = antenna::CURVE_NODES, LAST = NODES - 1;  // of a curve, and the tip's
constexpr int WIDE_NODES = whole_lanes(NODES);
// Nodes at which derivatives by the rig are computed: every third, the contact and both ends among them. What is
// between is a cubic.
struct Samples {
    static constexpr int every = 3, count = LAST / every + 1;
};
static_assert(CONTACT % Samples::every == 0 && LAST % Samples::every == 0);
// Readings of a frame: those that every rig may have, then those of a sensor of more axes.
enum Reading : int { ABOUT_Y, ABOUT_Z, END, ABOUT_X, ALONG_X, ALONG_Y, ALONG_Z, READINGS };
// WRENCH: size of force and moment at the clamp, and 1, in which readings are linear. OF_MOMENT: parameters of the
// sensor about y, gain and offset.
enum : int { WRENCH = 7, OF_MOMENT = 2, USUAL_READINGS = ABOUT_X };
constexpr int GRID = 3 * LANES;  // distances that are tried before a fit begins
constexpr int STARTS = 2;        // minima that are searched for each frame
// Evaluations of the model after which a fit ends unconverged: sound frames take 3 to 30, by vision alone up to 200.
constexpr int MOST_EVALUATIONS = 400;
constexpr double TIP = 1.0;    // the tip's distance in antenna lengths
constexpr double FREE = 0.65;  // the free antenna is a contact here without a force: it only places the nodes
constexpr double HUBER = 2.5;  // whitened residuals beyond this count linearly
constexpr double TIP_DEFLECTION_STD = 0.3;  // prior of the tip's deflection, in antenna lengths

constexpr int REFERENCE = ROD;  // what the other rungs are compared with

using Unknowns = std::array<double, UNKNOWNS>;

template <class T, std::size_t A>
View<T, 1> view(T (&values)[A]) {
    return {values, {static_cast<int>(A)}};
}
template <class T, std::size_t A, std::size_t B>
View<T, 2> view(T (&values)[A][B]) {
    return {values[0], {static_cast<int>(A), static_cast<int>(B)}};
}
template <class T, std::size_t A, std::size_t B, std::size_t C>
View<T, 3> view(T (&values)[A][B][C]) {
    return {values[0][0], {static_cast<int>(A), static_cast<int>(B), static_cast<int>(C)}};
}

// A camera that watches the antenna, and where its parameters stand among the rig's.
struct Camera {
    const lens::Lens* lens;
    int pose_at, lens_at;                     // its pose's six, and its lens' if the rig knows their uncertainty
    double pose_lanes[3][4][LANES];           // rotation and translation into it of poses moved along each tangent axis
    double rotation[3][3], translation_m[3];  // antenna frame to camera
    double to_camera[2];                      // unit direction across the antenna's x axis to it
    double eye_m[3];                          // its centre in the clamp's frame
    double focal;                             // mean focal length, px
    Array<double, 1> line;     // (L,) σ of the found line's own errors: offset, slope, curvature; or none
    std::vector<int> vectors;  // of a fit's columns, in order: the others are zero at the nodes of its picture
};

// The rig as known before any frame, see `RigArrays` in Python.
struct Rig {
    double length_m, radius_m, friction_rad, force_unit_N, unit_load, tip_offset_m, stiffness_Nm2;
    // whether the rig knows the antenna's end, reads more than the moment about y, and the lens' uncertainty
    bool with_tip, with_wrench, with_lens;
    int readings;  // how many of READINGS are in use: USUAL_READINGS or all
    int made;      // serial number of the rig, different for each
    std::vector<Camera> cameras;
    antenna::Taper taper;
    Array<double, 2> unit_deflection;  // (NODES, GRID) of a free antenna's nodes by unit forces at the grid's distances
    double antenna_parameters[ANTENNA], antenna_steps[ANTENNA];
    double by_pose_step[LANES];          // one over the steps of `pose_lanes`, zeros after the sixth
    double std[READINGS];                // of the readings; 1 for a missing one
    double by_wrench[READINGS][WRENCH];  // the readings, in σ, by force, moment and 1; 0 for a missing one
    // (S, READINGS, WRENCH) that by a unit of the sensor's parameters: OF_MOMENT, and then those before the tip's
    Array<double, 3> by_sensor;
    int more_at, tip_at;      // where the sensor's parameters beyond OF_MOMENT and the tip's stand among the rig's
    double most_information;  // that its axes are enough for, see `information_of`
    int shared;               // R independent axes of the rig's errors, which all frames share
    Array<double, 2> axes;    // (Q, R) steps of the Q parameters of unit σ, each row filled with zeros to whole vectors

    // nodes of all pictures of the antenna, one camera's after the other's
    int nodes() const { return NODES * static_cast<int>(cameras.size()); }
    int samples() const { return Samples::count * static_cast<int>(cameras.size()); }
    // L of each camera, one after the other
    int lines() const { return cameras[0].line.size() * static_cast<int>(cameras.size()); }
    int steps() const { return shared + lines(); }
    // rows of the arrays that hold readings: whole threes
    int reading_rows() const { return (readings + 2) / 3 * 3; }
};

// Small deflection of the tip by a unit force at a distance, both in antenna lengths.
inline double tip_deflection(const Rig& rig, double distance) {
    return rig.unit_load * antenna::deflection(rig.taper, TIP, distance);
}

// The load F·l²/EI of a unit force at a distance: twice the slope that it makes there, if small.
inline double load_at(const Rig& rig, double distance) {
    return 2.0 * rig.unit_load * antenna::deflection_by_contact(rig.taper, distance, distance);
}

// Free antennas of at most LANES frames next to each other, each under its own gravity (some, 3); bent when asked for.
struct FreeShapes {
    const Rig* rig = nullptr;
    ConstMatrix gravity_m_s2;
    bool bent = false;
    double points_m[3][NODES][LANES], tangents[3][NODES][LANES];
    double force_N[3][LANES], moment_Nm[LANES];
};

// One frame: its usable points in the ideal pictures and what the sensors read.
struct Frame {
    int count;                 // N points, one camera's after the other's
    Array<double, 2> points;   // (5, N′) u, v and covariance xx, xy, yy; what fills the rows to whole vectors is finite
    Array<int, 1> clamp;       // (N′,) the first node of the picture that each point is in
    int seen_by;               // the first camera that sees any
    double reading[READINGS];  // N·m or N; that of the end is not used
    double tip[2], tip_covariance[3];  // the antenna's end, as the points
    int tip_clamp;                     // the first node of the picture that it is in
    double available[READINGS];        // 1 where there is such a reading; less where it is noisier; 0 without
    double gravity_m_s2[3];            // antenna frame
    FreeShapes* free;                  // with its own among them, or none
    int lane;                          // its own

    const double* u() const { return points.begin(); }
    const double* v() const { return points.begin() + points.shape[1]; }
    const double* xx() const { return points.begin() + 2 * points.shape[1]; }
    const double* xy() const { return points.begin() + 3 * points.shape[1]; }
    const double* yy() const { return points.begin() + 4 * points.shape[1]; }
};

// State of a descent, to which it returns after a failed step.
struct State {
    Unknowns unknowns = {};
    Array<double, 1> steps;   // (R + L,) along the rig's independent axes, in σ
    Array<double, 1> foot_m;  // (N′,) arc lengths of the points of the curve nearest to the seen ones
    double cost = 0.0;        // robust, priors included
    double scatter = 1.0;     // factor on the points' σ
    double contact_m = 0.0;   // the contact's arc length on the nodes
    bool converged = false;
    bool at_tip = false;           // the distance is fixed at the tip
    Unknowns to_tip = {};          // if so: the unknowns less those of the fit with a free distance
    Array<double, 2> information;  // (K′, K′) of the normal equations, priors included
    Array<double, 1> side;         // (K′,) their right side

    State(int points, int rig_steps)
        : steps(rig_steps),
          foot_m(whole_lanes(points)),
          information(whole_lanes(UNKNOWNS + rig_steps), whole_lanes(UNKNOWNS + rig_steps)),
          side(whole_lanes(UNKNOWNS + rig_steps)) {}
};

// A fit of N points in K unknowns and rig steps. Rows are whole vectors: K′ and N′ are K and N rounded up, and what
// fills them is zero, or finite and without weight. Assignment copies one fit into another of the same sizes.
struct Fit : State {
    int points, size, readings, nodes;              // N, K, of READINGS, M
    double points_m[3][NODES], tangents[3][NODES];  // of the predicted antenna, antenna frame
    Array<double, 1> u, v, depth;                   // (M,) its ideal pictures, one camera's after the other's
    Array<double, 1> normal_u, normal_v;            // (M,) unit normals there
    // (M, 8) the pictures between nodes: four coefficients of u, then of v, by the share of the way
    Array<double, 2> cubics;
    Array<double, 2> columns;              // (M, K′) displacement along the normals by unknowns and rig steps
    Array<double, 2> reading_columns;      // (reading_rows, K′) of the predicted readings, in σ
    double point_force[6];                 // contact point, m, and force, N, antenna frame
    Array<double, 2> point_force_columns;  // (6, K′)
    // what was read less what is predicted, in σ; with the rig's steps
    double predicted_residual[READINGS], residual[READINGS];
    Array<int, 1> node;          // (N′,) the node before each foot
    Array<double, 1> share;      // (N′,) the part of the way to the next one
    Array<double, 1> distance;   // (N′,) of the points from the curve along its normal, the rig's steps taken out
    Array<double, 1> precision;  // (N′,) one over the variance of that
    // weighted sums of the points over nodes, a tridiagonal information and its right side. For values c on the nodes,
    // linear between them: Σ w c² = Σ diagonal·c² + 2 Σ off_diagonal·c·c₊₁ and Σ w c·r = Σ pull·c
    Array<double, 1> diagonal, off_diagonal, pull;  // (M,)

    Fit(int count, const Rig& rig)
        : State(count, rig.steps()),
          points(count),
          size(UNKNOWNS + rig.steps()),
          readings(rig.readings),
          nodes(rig.nodes()),
          points_m{},
          tangents{},
          u(nodes),
          v(nodes),
          depth(nodes),
          normal_u(nodes),
          normal_v(nodes),
          cubics(nodes, 8),
          columns(nodes, whole_lanes(size)),
          reading_columns(rig.reading_rows(), whole_lanes(size)),
          point_force{},
          point_force_columns(6, whole_lanes(size)),
          predicted_residual{},
          residual{},
          node(whole_lanes(count)),
          share(whole_lanes(count)),
          distance(whole_lanes(count)),
          precision(whole_lanes(count)),
          diagonal(nodes),
          off_diagonal(nodes),
          pull(nodes) {}
};

inline void keep(const Fit& fit, State& kept) { kept = fit; }

// Return to a state; what belongs to the curve stays as it is.
inline void go_back(const State& kept, Fit& fit) { static_cast<State&>(fit) = kept; }

// Arc length, m, of a place counted in nodes, which are equally spaced on either side of the contact.
inline double arclength_of_node(const Fit& fit, double length_m, double node) {
    const double past = node > CONTACT ? node - CONTACT : 0.0;
    return (node - past) * (fit.contact_m / CONTACT) + past * ((length_m - fit.contact_m) / NODES_BEYOND);
}

struct Place {
    int node;      // before it
    double share;  // of the way to the next node
    double width;  // from node to node, m
};

// Where an arc length lies between the nodes.
Place locate(const Fit& fit, double length_m, double arclength_m);

// Shapes of LANES antennas next to each other and their ideal pictures; scratch room of one frame.
struct alignas(LANES * sizeof(double)) Bent {
    double parameters[ANTENNA][LANES];
    double contact_m[LANES], push_N[2][LANES], friction_rad[LANES];
    double points_m[3][NODES][LANES];
    double tangents[3][WIDE_NODES];  // of the first shape
    double force_N[3][LANES], moment_Nm[LANES];
    Array<double, 2> u, v, depth;  // (M, LANES)
    double by_step[LANES];         // one over each lane's step
    double by_lens[2][18][LANES], seen[6][LANES];
    Array<double, 2> axes;  // (Q, K′) the rig's, in the columns that a fit has for them, zeros elsewhere
    // derivatives by the rig's Q parameters, (samples, Q′) of each picture, (reading_rows, Q′), (6, Q′), with room to
    // write whole vectors anywhere
    Array<double, 2> raw, raw_readings, raw_point_force;

    explicit Bent(const Rig& rig);
};

// Key of the cached free antenna: rig, gravity and available readings; and its predicted readings, in σ. Successive
// frames mostly share it.
struct FreeKey {
    int made = -1;
    double gravity_m_s2[3] = {}, available[READINGS] = {}, readings[READINGS] = {};

    bool is_of(const Rig& rig, const Frame& frame) const {
        return made == rig.made && std::equal(gravity_m_s2, gravity_m_s2 + 3, frame.gravity_m_s2) &&
               std::equal(available, available + READINGS, frame.available);
    }
};

// Scratch room for one frame at a time.
struct Work {
    Bent bent;
    Fit free;                                      // the free antenna
    FreeKey known;                                 // its
    Fit best, found;                               // of the frame's minima
    Fit other;                                     // for whatever is done at the moment
    State kept;                                    // lowest of a descent
    Array<double, 1> shift;                        // (M,)
    Array<double, 2> product;                      // (M, K′)
    Array<double, 2> factor;                       // (K′, K′)
    Array<double, 1> scale, step;                  // (K′,)
    Unknowns start = {}, slopes_at = {};           // where the rig's derivatives were taken last
    int evaluations = 0, most = MOST_EVALUATIONS;  // of the model so far, and after how many to give up

    Work(const Rig& rig, int points);
};

// A frame that is fitted on a rung, and the room for it.
struct Task {
    const Rig& rig;
    const Frame& frame;
    int rung;
    Work& work;
};

// Distances of the grid, what unit forces there do, and what the best forces explain.
struct Grid {
    double distance[GRID];   // antenna lengths
    Array<double, 2> image;  // (2, M) displacement of the pictures by a unit force along y and z, per deflection of a
                             // unit beam
    double moment[2][GRID];  // response, in σ, of the sensor about z to a unit force along y; of that about y to one
                             // along z
    double more[2][READINGS][GRID];  // of a wrench sensor's readings to both, which then are not in `moment`
    double force[GRID][2];           // the best ones
    double gain[GRID];               // decrease of the cost by each
    Array<double, 1> shift;          // (M,) displacement by the best force and the rig's steps at it
    Array<double, 1> weight;         // (N,) of the points
    Array<double, 2> crossed;        // (R + L, 2 G + LANES) what rig steps and unit forces have in common
};

// First-order uncertainty of a fit with R rig steps.
struct Uncertainty {
    double covariance[UNKNOWNS][UNKNOWNS];  // from noise and rig together; infinite where not observable
    Array<double, 2> rig_response;          // (R, 4) derivatives of the rig's likeliest steps by the unknowns
    double touch[6][UNKNOWNS];              // contact point and force by the unknowns, the rig's steps going with them
    Array<double, 2> rig_touch;    // (R, 6) covariance of the rig's steps, for a known contact, with point and force
    double touch_by_rig[6][6];     // part of their covariance due to the rig's steps, for a known contact
    double condition;              // of the contact's own information, scaled to a unit diagonal
    double reading_std[READINGS];  // σ of each reading's whitened residual, below one as far as the moment was fitted

    explicit Uncertainty(int steps) : rig_response(steps, UNKNOWNS), rig_touch(steps, 6) {}
};

}  // namespace vbaa::solver
