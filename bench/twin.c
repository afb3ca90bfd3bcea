/* The twin's loop in plain C, for a comparison of speed: LuGre with Gaussian Stribeck friction and a
 * torque ripple, leapfrog steps, quantiser and PID with hold. See autotune/models/plant.py. */
#include <math.h>

static double limit_of(const double *p, double v) {
    double ratio = v / p[7];
    double level = p[2] + (p[6] - p[2]) * exp(-ratio * ratio);
    double limit = level / p[3];
    return limit > 1e-15 ? limit : 1e-15;
}

static double clamp(double x, double most) {
    return x > most ? most : (x < -most ? -most : x);
}

long simulate(const double *p, double *s, const double *gains, double *loop, long substeps, long n,
              const double *reference, const double *disturbance, double *position, double *torque) {
    double h = loop[0], most = loop[1], grain = loop[2];
    double total = loop[3], rate = loop[4], last_r = loop[5], last_y = loop[6];
    double step = h / substeps;
    double q = s[0], v = s[1], z = s[2];
    for (long k = 0; k < n; k++) {
        double y = floor(q / grain + 0.5) * grain;
        double error = reference[k] - y;
        double change = (reference[k] - last_r - y + last_y) / h;
        rate += gains[3] * (change - rate);
        double demand = gains[0] * error + gains[1] * rate + gains[2] * (total + error * h);
        if (fabs(demand) <= most) total += error * h;
        last_r = reference[k];
        last_y = y;
        demand = clamp(demand, most);
        position[k] = y;
        torque[k] = demand;
        double drive = demand + disturbance[k];
        for (long i = 0; i < substeps; i++) {
            double limit = limit_of(p, v);
            double distance = fabs(v) * step / limit;
            if (distance >= 1e-12) {
                double steady = copysign(limit, v);
                z = steady + (z - steady) * exp(-distance);
            }
            double zdot = v - fabs(v) / limit * z;
            double middle = q + 0.5 * step * v;
            double outside = p[5] + p[8] * sin(p[10] * middle) + p[9] * cos(p[10] * middle);
            double friction = p[3] * z + p[4] * zdot + p[1] * v;
            double slope = p[1] + p[4] * fmax(1.0 - copysign(1.0, v) * z / limit, 0.0);
            double later = v + step * (drive - outside - friction) / (p[0] + 0.5 * step * slope);
            q += 0.5 * step * (v + later);
            v = later;
        }
    }
    s[0] = q; s[1] = v; s[2] = z;
    loop[3] = total; loop[4] = rate; loop[5] = last_r; loop[6] = last_y;
    return n;
}
