/* The two-link biped of the paper under its control laws, for one scenario: RK4, and the worst values on the way.

   Written from Newton's and Euler's equations of body and foot, and from the definitions that `poise explain` prints;
   it shares no code with Poise. SI units and radians; x forward (toe side), y up; angles are positive towards the toe.

   body, about the ankle     I theta'' = (M g - F_y) L sin(theta) + F_x L cos(theta) + tau               (1)-(2)
   body, centre of gravity   M a_x = R_x + F_x,   M a_y = R_y + F_y - M g                                (7)
   foot at rest              N = F_T + F_H = m g + R_y
                             toe F_T - heel F_H = -tau + c m g - h R_x,   c = (toe - heel)/2             (5)-(6)
   centre of pressure        P = (toe F_T - heel F_H)/N                                                  (18)
   law pd                    tau = -K_d omega + K_p (theta_d - theta)
   law force                 ... + K_f s,   s' = N (P_d - P)/ell,  ell = (toe + heel)/2: F_H - F_T       (8)-(9)
   law cop                   ... + K_f (M + m) g/ell s,   s' = P_d - P                                   (20)
   slope alpha               F_x = M g sin(alpha),   F_y = M g (1 - cos(alpha))                          (21)
   friction                  R_x over N; on a slope and a moving floor gravity along the ground, and the floor's
                             acceleration, pull the foot too, with m/M times F: (R_x - m/M F_x)/(N - m/M F_y)

   The signal (alpha, or F_x and F_y) is piecewise linear. Steps have the length `step`, end at every corner, and use
   the forces of their own piece; both sides of a jump are samples. */

#include <math.h>

enum { PD, FORCE, COP };
enum { APPLIED, SLOPE, FLOOR };

typedef struct { double M, L, I, m, toe, heel, h, g, on_foot; } Body; /* on_foot: share of the force that acts on it too */
typedef struct { int kind; double K_p, K_d, K_f, theta_d, P_d; } Law;
typedef struct { double tau, tau_rate, alpha, s_rate, F_T, F_H, P, slip; } Instant;

/* positions in `worst`: a value, then its time */
enum { TOE = 0, HEEL = 2, MARGIN = 4, TORQUE = 6, TORQUE_RATE = 8, FRICTION = 10, SETTLING = 12, OVERSHOOT = 14,
       POSTURE_ERROR = 16, FINAL = 17, FALL = 20, ABANDONED = 21, WORST_SIZE = 22 };

/* Everything at one instant; alpha is the angular acceleration. */
static inline Instant evaluate(const Body *b, const Law *law, double theta, double omega, double s, double F_x,
                               double F_y) {
    Instant now;
    double sine = sin(theta), cosine = cos(theta), ell = 0.5 * (b->toe + b->heel), gain = 0.0;
    if (law->kind == FORCE) gain = law->K_f;
    if (law->kind == COP) gain = law->K_f * (b->M + b->m) * b->g / ell;
    now.tau = law->K_p * (law->theta_d - theta) - law->K_d * omega + gain * s;
    now.alpha = ((b->M * b->g - F_y) * b->L * sine + F_x * b->L * cosine + now.tau) / b->I;
    double R_x = b->M * b->L * (now.alpha * cosine - omega * omega * sine) - F_x;
    double R_y = -b->M * b->L * (now.alpha * sine + omega * omega * cosine) + b->M * b->g - F_y;
    double N = b->m * b->g + R_y;
    double moment = -now.tau + 0.5 * (b->toe - b->heel) * b->m * b->g - b->h * R_x; /* toe F_T - heel F_H = N P */
    now.F_T = (b->heel * N + moment) / (2.0 * ell);
    now.F_H = (b->toe * N - moment) / (2.0 * ell);
    now.P = moment / N;
    now.slip = (R_x - b->on_foot * F_x) / (N - b->on_foot * F_y);
    now.s_rate = law->kind == PD ? 0.0 : law->kind == FORCE ? (law->P_d * N - moment) / ell : law->P_d - now.P;
    now.tau_rate = -law->K_p * omega - law->K_d * now.alpha + gain * now.s_rate;
    return now;
}

/* The force (F_x, F_y) at `t` on the piece (t0, t1, first, second component at t0, the same at t1). */
static inline void force_at(const Body *b, int world, const double *piece, double t, double *F_x, double *F_y) {
    double share = (t - piece[0]) / (piece[1] - piece[0]);
    double first = piece[2] + share * (piece[4] - piece[2]), second = piece[3] + share * (piece[5] - piece[3]);
    *F_x = world == SLOPE ? b->M * b->g * sin(first) : first;
    *F_y = world == SLOPE ? b->M * b->g * (1.0 - cos(first)) : second;
}

static inline void lower(double *worst, double value, double t) {
    if (value < worst[0]) worst[0] = value, worst[1] = t;
}

static inline void raise(double *worst, double value, double t) {
    if (value > worst[0]) worst[0] = value, worst[1] = t;
}

static void note(const Body *b, const Instant *now, double t, double *worst) {
    lower(worst + TOE, now->F_T, t);
    lower(worst + HEEL, now->F_H, t);
    lower(worst + MARGIN, fmin(b->toe - now->P, b->heel + now->P), t);
    raise(worst + TORQUE, fabs(now->tau), t);
    raise(worst + TORQUE_RATE, fabs(now->tau_rate), t);
    raise(worst + FRICTION, fabs(now->slip), t);
}

/* Settling and overshoot: `steady_from` is when the force has come to its last value, `rest` the posture then. */
static void transient(const double *times, const double *angles, int count, double steady_from, double rest,
                      double *worst) {
    double largest = 0.0, settled = steady_from, side = 0.0;
    int first = -1, last_outside = -1;
    for (int k = 0; k < count; k++) largest = fmax(largest, fabs(angles[k] - rest));
    for (int k = 0; k < count; k++) {
        if (times[k] < steady_from) continue;
        if (first < 0) first = k;
        if (fabs(angles[k] - rest) > 0.02 * largest) last_outside = k;
    }
    worst[OVERSHOOT] = 0.0, worst[OVERSHOOT + 1] = steady_from;
    worst[SETTLING] = INFINITY, worst[SETTLING + 1] = times[count - 1];
    worst[POSTURE_ERROR] = fabs(angles[count - 1] - rest);
    if (first < 0) return;
    if (last_outside >= 0 && last_outside + 1 < count) settled = times[last_outside + 1];
    if (last_outside != count - 1 && worst[FALL] < 0.0)
        worst[SETTLING] = settled - steady_from, worst[SETTLING + 1] = settled;
    if (fabs(angles[first] - rest) > 1e-9 + 1e-6 * largest) side = angles[first] > rest ? -1.0 : 1.0;
    for (int k = first; k < count; k++) {
        double past = side == 0.0 ? fabs(angles[k] - rest) : side * (angles[k] - rest);
        if (past > worst[OVERSHOOT]) worst[OVERSHOOT] = past, worst[OVERSHOOT + 1] = times[k];
    }
}

/* Run one scenario of `count` pieces (6 numbers each, see force_at) from (theta, omega), s = 0.

   numbers: the body's M, L, I, m, toe, heel, h, g; law: K_p, K_d, K_f, theta_d, P_d. `worst` receives what the enum
   above lists. `times` and `angles` receive the samples; they need room for one a step and two a piece. The run is
   abandoned where a contact force is below `give_up`. Returns the number of samples. */
int simulate(const double *numbers, int kind, const double *law_numbers, int world, int count, const double *pieces,
             const double *start, double step, double steady_from, double rest, double give_up, double *worst,
             double *times, double *angles) {
    Body b = {numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5], numbers[6], numbers[7],
              world == APPLIED ? 0.0 : numbers[3] / numbers[0]};
    Law law = {kind, law_numbers[0], law_numbers[1], law_numbers[2], law_numbers[3], law_numbers[4]};
    double theta = start[0], omega = start[1], s = 0.0;
    int n = 0;
    for (int k = 0; k < WORST_SIZE; k++) worst[k] = 0.0;
    worst[TOE] = worst[HEEL] = worst[MARGIN] = INFINITY;
    worst[TORQUE] = worst[TORQUE_RATE] = worst[FRICTION] = -INFINITY;
    worst[FALL] = worst[ABANDONED] = -1.0;
    for (int p = 0; p < count; p++) {
        const double *piece = pieces + 6 * p;
        double t = piece[0], end = piece[1], F_x, F_y, F_xm, F_ym, F_xe, F_ye;
        double near = 1e-9 * step + 1e-12 * end;
        long multiple = (long)floor(t / step + 1e-6);
        force_at(&b, world, piece, t, &F_x, &F_y);
        Instant a = evaluate(&b, &law, theta, omega, s, F_x, F_y);
        for (;;) {
            if (!(fabs(theta) < M_PI_2) || !isfinite(a.F_T) || !isfinite(s)) {
                worst[FALL] = t;
                goto done;
            }
            note(&b, &a, t, worst);
            times[n] = t, angles[n] = theta, n++;
            if (fmin(a.F_T, a.F_H) < give_up) {
                worst[ABANDONED] = t;
                goto done;
            }
            if (t >= end) break;
            double next = end;
            while (multiple * step <= t + near) multiple++;
            if (multiple * step < end - near) next = multiple * step;
            /* one step of the classical Runge-Kutta method; its first stage is the sample just read */
            double h = next - t;
            force_at(&b, world, piece, t + 0.5 * h, &F_xm, &F_ym);
            force_at(&b, world, piece, next, &F_xe, &F_ye);
            double o2 = omega + 0.5 * h * a.alpha;
            Instant k2 = evaluate(&b, &law, theta + 0.5 * h * omega, o2, s + 0.5 * h * a.s_rate, F_xm, F_ym);
            double o3 = omega + 0.5 * h * k2.alpha;
            Instant k3 = evaluate(&b, &law, theta + 0.5 * h * o2, o3, s + 0.5 * h * k2.s_rate, F_xm, F_ym);
            double o4 = omega + h * k3.alpha;
            Instant k4 = evaluate(&b, &law, theta + h * o3, o4, s + h * k3.s_rate, F_xe, F_ye);
            theta += h / 6.0 * (omega + 2.0 * o2 + 2.0 * o3 + o4);
            omega += h / 6.0 * (a.alpha + 2.0 * k2.alpha + 2.0 * k3.alpha + k4.alpha);
            s += h / 6.0 * (a.s_rate + 2.0 * k2.s_rate + 2.0 * k3.s_rate + k4.s_rate);
            t = next;
            a = evaluate(&b, &law, theta, omega, s, F_xe, F_ye);
        }
    }
done:
    worst[FINAL] = theta, worst[FINAL + 1] = omega, worst[FINAL + 2] = s;
    if (n > 0) transient(times, angles, n, steady_from, rest, worst);
    return n;
}
