#include "pendulum.hpp"

#include <algorithm>
#include <cmath>

namespace vbaa::antenna {

namespace {

// Number of terms of the series for full precision up to its largest load.
constexpr int TERMS = 40;
constexpr double SERIES_RADIUS = 6.875185818020372;  // in v^2: 2 K(1/2)^2

constexpr std::array<double, 2 * TERMS + 1> RECIPROCAL = [] {
    std::array<double, 2 * TERMS + 1> made = {};
    for (int n = 1; n <= 2 * TERMS; ++n) made[n] = 1.0 / n;
    return made;
}();

// Taylor coefficients of psi/v^2, cos psi and sin psi in v^2.
template <class T>
struct Taylor {
    T psi[TERMS], cosine[TERMS + 1], sine[TERMS + 1];
};

template <class T>
T of(double value) {
    if constexpr (sizeof(T) == sizeof value)
        return value;
    else
        return spread(value);
}

// The coefficients from psi'' = cos(psi + alpha), term by term.
template <class T>
void expand(T sin_friction, T cos_friction, int terms, Taylor<T>& series) {
    T rates[TERMS];
    series.cosine[0] = of<T>(1.0);
    series.sine[0] = T{};
    for (int n = 0; n < terms; ++n) {
        T second = cos_friction * series.cosine[n] - sin_friction * series.sine[n];
        series.psi[n] = second * of<T>(RECIPROCAL[2 * n + 2] * RECIPROCAL[2 * n + 1]);
        rates[n] = series.psi[n] * of<T>(n + 1.0);
        T sine = T{}, cosine = T{};
        for (int k = 0; k <= n; ++k) {
            sine += rates[k] * series.cosine[n - k];
            cosine -= rates[k] * series.sine[n - k];
        }
        series.cosine[n + 1] = cosine * of<T>(RECIPROCAL[n + 1]);
        series.sine[n + 1] = sine * of<T>(RECIPROCAL[n + 1]);
    }
}

UniversalPoint by_series(double upsilon, const Taylor<double>& series, int terms) {
    double square = upsilon * upsilon, psi = 0.0, along = 0.0, across = 0.0;
    for (int term = terms - 1; term >= 0; --term) {
        psi = psi * square + series.psi[term];
        along = along * square + series.cosine[term] / (2.0 * term + 1.0);
        across = across * square + series.sine[term + 1] / (2.0 * term + 3.0);
    }
    return {psi * square, along * upsilon, across * square * upsilon};
}

}  // namespace

Landen landen(double m) {
    Landen chain;
    double mean = 1.0, other = std::sqrt(1.0 - m), power = 1.0, lost = m;
    for (chain.count = 0; chain.count < LANDEN_STEPS && mean - other > 1e-15 * mean; ++chain.count) {
        double half_gap = 0.5 * (mean - other), root = std::sqrt(mean * other);
        mean = 0.5 * (mean + other);
        other = root;
        power *= 2.0;
        lost += power * half_gap * half_gap;
        chain.steps[chain.count] = {half_gap, half_gap / mean, other / mean};
    }
    chain.amplitude_scale = power * mean;
    chain.second_scale = 1.0 - 0.5 * lost;
    chain.m = m;
    return chain;
}

Jacobi jacobi_at(double u, const Landen& chain) {
    double amplitude = chain.amplitude_scale * u, second = chain.second_scale * u;
    for (int step = chain.count - 1; step >= 0; --step) {
        const auto& [half_gap, sine, cosine] = chain.steps[step];
        double s = std::sin(amplitude), c = std::cos(amplitude);
        second += half_gap * s;
        // the arcsine of sine·sin, which alone would lose half of the digits where that is nearly 1
        double rest = std::sqrt(c * c + (cosine * s) * (cosine * s));
        amplitude = 0.5 * (amplitude + std::atan2(sine * s, rest));
    }
    double s = std::sin(amplitude), c = std::cos(amplitude);
    return {s, c, std::sqrt((1.0 - chain.m) + chain.m * c * c), second};
}

// With k^2 = (1 - sin alpha)/2 and k'^2 = 1 - k^2, tan(psi/2) = k k' (1 - cn)/(k'^2 + k^2 cn); in the force's frame
// (x along it) the integral of cos chi is chi', and that of sin chi follows from the energy.
UniversalPoint closed_form(double upsilon, double friction_rad, const Landen& chain) {
    auto [sn, cn, dn, second] = jacobi_at(upsilon, chain);
    double sine = std::sin(friction_rad), cosine = std::cos(friction_rad), m = chain.m;
    // cos alpha = 2 k k'
    double half_sine = 0.5 * cosine * (cn > 0.0 ? sn * sn / (1.0 + cn) : 1.0 - cn);
    double psi = 2.0 * std::atan2(half_sine, (1.0 - m) + m * cn);
    double along = cosine * sn / dn;
    double across = 2.0 * second - upsilon - 2.0 * m * sn * cn / dn;
    return {psi, cosine * along + sine * across, cosine * across - sine * along};
}

void universal_curve(ConstMatrix upsilon, ConstVector friction_rad, Cube curve) {
    Taylor<double> series;
    for (int row = 0; row < upsilon.shape[0]; ++row) {
        double largest = upsilon(row, 0) * upsilon(row, 0), friction = friction_rad[row];
        bool closed = largest > SERIES_LOAD;
        Landen chain;
        int terms = 0;
        if (closed) {
            chain = landen(0.5 * (1.0 - std::sin(friction)));
        } else {
            terms = series_terms(largest);
            expand(std::sin(friction), std::cos(friction), terms, series);
        }
        for (int n = 0; n < upsilon.shape[1]; ++n) {
            double at = upsilon(row, n);
            UniversalPoint found = closed ? closed_form(at, friction, chain) : by_series(at, series, terms);
            curve(0, row, n) = found.psi;
            curve(1, row, n) = found.along;
            curve(2, row, n) = found.across;
        }
    }
}

SineCosine sine_and_cosine(Lanes angle_rad) {
    // n!'s inverses with alternating signs: Taylor coefficients in the angle's square
    constexpr int terms = 12;
    static const std::array<double, 2 * terms> inverse = [] {
        std::array<double, 2 * terms> made;
        double factorial = 1.0;
        for (int n = 0; n < 2 * terms; factorial *= ++n) made[n] = (n / 2 % 2 ? -1.0 : 1.0) / factorial;
        return made;
    }();
    Lanes square = angle_rad * angle_rad, sine = Lanes{}, cosine = Lanes{};
    for (int term = terms - 1; term >= 0; --term) {
        sine = sine * square + spread(inverse[2 * term + 1]);
        cosine = cosine * square + spread(inverse[2 * term]);
    }
    return {angle_rad * sine, cosine};
}

int series_terms(double largest_load) {
    double largest = std::max(1e-6, largest_load);
    return std::min(TERMS, static_cast<int>(std::ceil(std::log(1e-18) / std::log(largest / SERIES_RADIUS))));
}

void hinge_by_series(Lanes loads, SineCosine friction, int terms, Hinge& hinge) {
    const NodeTables& tables = node_tables();
    Taylor<Lanes> series;
    expand(friction.sine, friction.cosine, terms, series);
    for (int node = 0; node < INNER_NODES - 1; ++node) {
        double back = 1.0 - tables.inner[node];
        Lanes square = loads * spread(back * back), total = Lanes{}, rate = Lanes{};
        for (int term = terms - 1; term >= 0; --term) {
            total = total * square + series.psi[term];
            rate = rate * square + spread(2.0 * term + 2.0) * series.psi[term];
        }
        SineCosine turn = sine_and_cosine(total * square);
        hinge.sine[node] = -turn.sine;
        hinge.cosine[node] = turn.cosine;
        hinge.slope[node] = spread(back) * rate;
    }
}

}  // namespace vbaa::antenna
