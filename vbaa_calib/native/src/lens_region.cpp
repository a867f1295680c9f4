// How far a lens may be trusted, and the patient search for the way back.
//
// The radial map ρ(r) = r·g(r²) is followed from the axis to its fold, its pole or the chart's end, and tabled there: a
// table gives start and bracket, and Newton the digits.
#include <algorithm>

#include "lens_maps.hpp"

namespace vbaa::lens {
namespace {

constexpr double FARTHEST = 1e3;  // ideal radius at which a distorted perspective lens is cut off: 89.94° off the axis
constexpr double BEYOND = 1e6;    // squared radius beyond which folds and poles are of no concern
constexpr double TO_THE_END = 1.0 - 1e-12;  // at a pole there is no value
constexpr double MARGIN = 1.003;            // of the rim around what the region is distorted to
constexpr double SHORTEST = 1e-3;           // length of a damped step at which the search ends
constexpr double FLAT = 1e-7;               // a pair of roots as near to the real axis, relative to its size, counts
constexpr int NODES = 2048, DIRECTIONS = 90, RADII = 160, HALVINGS = 30;
constexpr int TABLE_STEPS = 12, SAFE_STEPS = 60, DAMPED_STEPS = 16;

// Residual that counts as zero: some tens of roundings of the largest term.
double tolerance(double size) { return 5e-14 * size + 1e-300; }

double polynomial(const std::vector<double>& c, double s) {
    double value = 0.0;
    for (int i = static_cast<int>(c.size()) - 1; i >= 0; --i) value = value * s + c[i];
    return value;
}

std::vector<double> derivative(const std::vector<double>& c) {
    std::vector<double> found;
    for (int i = 1; i < static_cast<int>(c.size()); ++i) found.push_back(i * c[i]);
    return found;
}

// Roots of Σ c_i s^i in (0, 1], increasing: between the roots of the derivative there is at most one.
std::vector<double> roots_within_one(const std::vector<double>& c) {
    if (c.size() < 2) return {};
    const std::vector<double> slope = derivative(c), bend = derivative(slope);
    std::vector<double> found;
    double low = 0.0, at_low = c[0];
    std::vector<double> ends = roots_within_one(slope);
    ends.push_back(1.0);
    for (double high : ends) {
        const double at_high = polynomial(c, high);
        if ((at_low < 0.0) != (at_high < 0.0) && at_low != 0.0) {
            double a = low, b = high;
            for (double middle = 0.5 * (a + b); a < middle && middle < b; middle = 0.5 * (a + b))
                ((polynomial(c, middle) < 0.0) == (at_low < 0.0) ? a : b) = middle;
            found.push_back(b);
        } else if (high < 1.0 &&
                   std::abs(at_high) <= 0.5 * std::abs(polynomial(bend, high)) * FLAT * FLAT * high * high) {
            found.push_back(high);  // a double root that rounding has made complex: the lens is flat there
        }
        low = high, at_low = at_high;
    }
    return found;
}

// Smallest root in (0, limit] of Σ c_i s^i, or infinity; last terms that do not matter up to the limit are left out.
double smallest_root(std::vector<double> c, double limit) {
    double power = 1.0, largest = 0.0;
    for (double& one : c) {
        one *= power, power *= limit;
        largest = std::max(largest, std::abs(one));
    }
    while (!c.empty() && !(std::abs(c.back()) > 1e-15 * largest)) c.pop_back();
    const std::vector<double> found = roots_within_one(c);
    return found.empty() ? INFINITE : found.front() * limit;
}

// Smallest radius at which the radial map stops growing or has a pole; may be infinite.
double fold_radius(const Model& model) {
    const auto& c = model.coefficients;
    if (model.fisheye)
        return std::sqrt(smallest_root({1.0, 3.0 * c[0], 5.0 * c[1], 7.0 * c[2], 9.0 * c[3]}, M_PI * M_PI));
    const std::vector<double> top = {1.0, c[0], c[1], c[4]}, bottom = {1.0, c[5], c[6], c[7]};
    std::vector<double> growth(7);  // N D + 2 s (N' D − N D'): d(r g)/dr has its sign
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j) growth[i + j] += top[i] * bottom[j] * (1.0 + 2.0 * (i - j));
    return std::sqrt(std::min(smallest_root(growth, BEYOND), smallest_root(bottom, BEYOND)));
}

// Ideal radius of a distorted one by Newton kept inside the bracket, halving where it would leave.
double bracketed(const Model& model, double distorted_radius, double low, double high, int steps) {
    double radius = 0.5 * (low + high);
    const double close = 0.1 * tolerance(distorted_radius);
    for (int step = 0; step < steps; ++step) {
        const double s = radius * radius;
        const Gain<double> gain = radial(model, s);
        const double residual = radius * gain.value - distorted_radius;
        if (residual <= 0.0) low = radius;
        if (residual >= 0.0) high = radius;
        double next = radius - residual / (gain.value + 2.0 * s * gain.by_s);
        if (!(next > low && next < high)) next = 0.5 * (low + high);
        if (std::abs(residual) <= close || next == radius) break;
        radius = next;
    }
    return radius;
}

double chart_limit(const Model& model) { return model.fisheye ? M_PI : INFINITE; }

RadialTable radial_table(const Model& model) {
    const double end = std::atan(std::min({fold_radius(model), chart_limit(model), FARTHEST})) * TO_THE_END;
    std::vector<double> radius, distorted_radius;
    for (int i = 0; i < NODES; ++i) {
        const double r = std::tan(end * i / (NODES - 1)), rho = r * radial(model, r * r).value;
        if (i > 0 && !(std::isfinite(rho) && rho > distorted_radius.back())) break;
        radius.push_back(r), distorted_radius.push_back(rho);
    }
    RadialTable table;
    if (radius.size() < 2) return table;
    table.ideal_limit = radius.back(), table.distorted_limit = distorted_radius.back();
    const double last = table.distorted_limit / (1.0 + table.distorted_limit);
    table.nodes_per_unit = (NODES - 1) / last;
    table.nodes.assign(NODES, 0.0), table.steps.assign(NODES, 0.0);
    for (int i = 0, upper = 1; i < NODES; ++i) {
        const double even = last * i / (NODES - 1);
        const double target = i < NODES - 1 ? even / (1.0 - even) : table.distorted_limit;
        while (upper < static_cast<int>(radius.size()) - 1 && distorted_radius[upper] < target) ++upper;
        table.nodes[i] = bracketed(model, target, radius[upper - 1], radius[upper], TABLE_STEPS);
        if (i > 0) table.nodes[i] = std::max(table.nodes[i], table.nodes[i - 1]);
        if (i > 0) table.steps[i - 1] = table.nodes[i] - table.nodes[i - 1];
    }
    return table;
}

Rim rim_of(std::vector<double> radii) {
    const double inner = *std::min_element(radii.begin(), radii.end());
    radii.push_back(radii.front());
    return {radii, inner};
}

// Whether a rim turns left at every corner.
bool is_convex(const std::vector<double>& radii, const std::vector<double>& cosine, const std::vector<double>& sine) {
    for (int i = 0; i < DIRECTIONS; ++i) {
        const int j = (i + 1) % DIRECTIONS, k = (i + 2) % DIRECTIONS;
        const double x = radii[j] * cosine[j], y = radii[j] * sine[j];
        const double in_x = x - radii[i] * cosine[i], in_y = y - radii[i] * sine[i];
        if (!(in_x * (radii[k] * sine[k] - y) - in_y * (radii[k] * cosine[k] - x) > 0.0)) return false;
    }
    return true;
}

// Follow each direction from the axis until the Jacobian is no longer definite; never past the radial part's own fold
// or pole: what lies beyond a pole is another branch.
void trust(Lens& lens) {
    const double farthest = std::atan(lens.table.ideal_limit) * TO_THE_END;
    std::vector<double> cosine(DIRECTIONS), sine(DIRECTIONS), low(DIRECTIONS), reached(DIRECTIONS), radius(RADII);
    for (int i = 0; i < RADII; ++i) radius[i] = std::tan(farthest * i / (RADII - 1));
    const auto good = [&](int i, double r) {
        const Mapped<double> at = distorted(lens, r * cosine[i], r * sine[i]);
        return at.definite() && std::isfinite(at.x) && std::isfinite(at.y);
    };
    for (int i = 0; i < DIRECTIONS; ++i) {
        const double angle = -M_PI + 2.0 * M_PI * i / DIRECTIONS;
        cosine[i] = std::cos(angle), sine[i] = std::sin(angle);
        int end = 1;
        while (end < RADII && good(i, radius[end])) ++end;
        double high = radius[std::min(end, RADII - 1)];
        low[i] = radius[end - 1];
        for (int step = 0; step < HALVINGS; ++step) {
            const double middle = 0.5 * (low[i] + high);
            (good(i, middle) ? low[i] : high) = middle;
        }
    }
    // a rim with a notch can enclose two points with one image: fall back to the disc
    if (!is_convex(low, cosine, sine)) low.assign(DIRECTIONS, *std::min_element(low.begin(), low.end()));
    lens.distorted_limit = INFINITE;
    for (int i = 0; i < DIRECTIONS; ++i) {
        const auto put = [&](double r) {
            const Mapped<double> at = distorted(lens, r * cosine[i], r * sine[i]);
            const double place = (std::atan2(at.y, at.x) + M_PI) * (DIRECTIONS / (2.0 * M_PI)),
                         size = std::hypot(at.x, at.y);
            if (!std::isfinite(place)) return size;
            double& kept = reached[static_cast<int>(std::rint(place)) % DIRECTIONS];
            kept = std::max(kept, size);
            return size;
        };
        for (int k = 0; k < RADII && radius[k] <= low[i]; ++k) put(radius[k]);
        lens.distorted_limit = std::min(lens.distorted_limit, put(low[i]));
    }
    std::vector<double> around(DIRECTIONS);
    for (int i = 0; i < DIRECTIONS; ++i) {
        const double both = std::max(reached[(i + DIRECTIONS - 1) % DIRECTIONS], reached[(i + 1) % DIRECTIONS]);
        around[i] = MARGIN * std::max(reached[i], both);
    }
    lens.ideal = rim_of(low), lens.reach = rim_of(around), lens.ideal_limit = lens.ideal.inner;
}

// Newton with each step shortened until it stays inside the region and the residual falls; from (x, y) where that is
// inside, else from deep inside the region.
bool damped(const Lens& lens, double to_x, double to_y, double& x, double& y) {
    const auto inside = [&](const Mapped<double>& at, double px, double py) {
        return at.definite() && lens.ideal.encloses(px, py);
    };
    const auto residual = [&](const Mapped<double>& at) {
        return std::max(std::abs(to_x - at.x), std::abs(to_y - at.y));
    };
    const double size = std::hypot(to_x, to_y), allowed = tolerance(size);
    Mapped<double> at = distorted(lens, x, y);
    if (!inside(at, x, y)) {
        const double within = std::min(size, lens.table.distorted_limit);
        const double place = lens.table.nodes_per_unit * (within / (1.0 + within));
        const int index = lens.table.node(place);
        const double start = lens.table.nodes[index] + (place - index) * lens.table.steps[index];
        const double ratio = std::min(start, 0.5 * lens.ideal.inner) / (size + 1e-15);
        x = to_x * ratio, y = to_y * ratio;
        at = distorted(lens, x, y);
    }
    double length = 1.0;
    for (int step = 0; step < DAMPED_STEPS && residual(at) > allowed && length >= SHORTEST; ++step) {
        const double scale = length / at.determinant(), off_x = to_x - at.x, off_y = to_y - at.y;
        const double next_x = x + (at.yy * off_x - at.xy * off_y) * scale;
        const double next_y = y + (at.xx * off_y - at.yx * off_x) * scale;
        const Mapped<double> trial = distorted(lens, next_x, next_y);
        if (residual(trial) < residual(at) && inside(trial, next_x, next_y)) {
            x = next_x, y = next_y, at = trial;
            length = std::min(2.0 * length, 1.0);
        } else {
            length *= 0.5;
        }
    }
    // near a pole a rounding of the ideal point alone moves the distorted one by more than that
    const double steep = std::abs(at.xx) + std::abs(at.xy) + std::abs(at.yx) + std::abs(at.yy);
    const double moved = 0.1 * tolerance(steep * std::max(std::abs(x), std::abs(y)));
    return residual(at) <= allowed + moved && inside(at, x, y);
}

}  // namespace

Model model_of(bool fisheye, ConstVector parameters) {
    Model model;
    model.fisheye = fisheye;
    model.fx = parameters[0], model.fy = parameters[1], model.cx = parameters[2], model.cy = parameters[3];
    model.distortions = std::min(parameters.shape[0] - 4, 14);
    auto& c = model.coefficients;
    for (int i = 0; i < model.distortions; ++i) c[i] = parameters[4 + i];
    model.rational = !fisheye && (c[5] != 0.0 || c[6] != 0.0 || c[7] != 0.0);
    bool bends = false, decentred = false;
    for (int i = 0; i < 12; ++i) {
        const bool gain = fisheye || i < 2 || (i >= 4 && i < 8);
        (gain ? bends : decentred) |= c[i] != 0.0;
    }
    model.path = decentred ? Path::full : bends ? Path::radial : Path::none;
    model.tilted = !fisheye && model.distortions == 14;
    const double sx = std::sin(c[12]), cx = std::cos(c[12]), sy = std::sin(c[13]), cy = std::cos(c[13]);
    model.turn = {cy, sy * sx, -sy * cx, 0.0, cx, sx, sy, -cy * sx, cy * cx};
    return model;
}

Lens prepared(bool fisheye, ConstVector parameters) {
    Lens lens;
    static_cast<Model&>(lens) = model_of(fisheye, parameters);
    lens.ideal_limit = lens.distorted_limit = chart_limit(lens);
    if (lens.path == Path::none) return lens;
    lens.table = radial_table(lens);
    lens.ideal_limit = lens.table.ideal_limit, lens.distorted_limit = lens.table.distorted_limit;
    if (lens.path == Path::full) trust(lens);
    return lens;
}

bool Rim::encloses(double x, double y) const {
    const double square = x * x + y * y;
    if (square < inner * inner) return true;
    if (!std::isfinite(square)) return false;
    const int count = static_cast<int>(radii.size()) - 1;
    const double place = (std::atan2(y, x) + M_PI) * (count / (2.0 * M_PI));
    const int index = std::min(static_cast<int>(place), count - 1);
    return std::sqrt(square) < radii[index] + (place - index) * (radii[index + 1] - radii[index]);
}

bool sees(const Lens& lens, double x, double y) {
    const double square = x * x + y * y;
    if (square < lens.ideal_limit * lens.ideal_limit) return true;
    if (lens.path != Path::full || !std::isfinite(square)) return false;
    return distorted(lens, x, y).definite() && lens.ideal.encloses(x, y);
}

bool searched(const Lens& lens, double distorted_x, double distorted_y, double& x, double& y) {
    if (lens.path == Path::full) return damped(lens, distorted_x, distorted_y, x, y);
    const RadialTable& table = lens.table;
    const double size = std::hypot(distorted_x, distorted_y), place = table.nodes_per_unit * (size / (1.0 + size));
    const int index = table.node(place);
    const double node = table.nodes[index], step = table.steps[index];
    const double radius = bracketed(lens, size, node - step, node + 2.0 * step, SAFE_STEPS), s = radius * radius;
    const Gain<double> gain = radial(lens, s);
    x = distorted_x / gain.value, y = distorted_y / gain.value;
    return std::abs(radius * gain.value - size) <= tolerance(size) && gain.value + 2.0 * s * gain.by_s > 0.0 &&
           radius >= 0.0 && radius <= table.ideal_limit;
}

}  // namespace vbaa::lens
