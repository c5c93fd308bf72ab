/* The closed loop of Case 1 with default parameters, hand-written in C for comparison with the project's rollout.
 * Same model, same law (piddtsm, conditional anti-windup), same filtered differences, same RK4, same stored outputs.
 *
 *     gcc -O3 rollout.c -o rollout -lm
 *     ./rollout SAMPLES REPETITIONS
 *
 * prints the seconds of each repetition and, in the last line, the RMSE of both joints.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { JOINTS = 2, SIGNALS = 13 };

static const double DT = 0.001;
static const double LIMIT[JOINTS] = {100.0, 50.0};

/* Robot, eqs. (48)-(50). */
static const double M1 = 0.5, M2 = 1.5, R1 = 1.0, R2 = 0.85, J1 = 5.0, J2 = 5.0, GRAVITY = 9.8;

/* Law, eqs. (10)-(30). */
static const double K1 = 3.0, K2 = 0.5, ALPHA = 7.0 / 9.0, U_S = 5.0;
static const double KP = 2.0, KI = 1.0, KD = 0.5;
static const double K = 1.0, KAPPA = 0.01, XI = 0.01, UPSILON = 0.2;

/* Estimator, Remark 4. */
static const double VELOCITY_CUTOFF = 5000.0, ACCELERATION_CUTOFF = 1000.0;

typedef struct {
    double p1, p2, p3, p4, p5, p6;
} Model;

typedef struct {
    double h11, h12, h22, bias1, bias2;
} Terms;

typedef struct { /* of one joint */
    double q, dq, ddq;
    double e, s, sigma;
    double integral, tau_sw, gain;
    int saturated;
} Memory;

typedef struct { /* the arrays of a rollout */
    double *time, *position, *velocity, *effort, *reference, *signals;
} Result;

static Model model_of(void) {
    Model m;
    m.p1 = (M1 + M2) * R1 * R1 + M2 * R2 * R2 + J1;
    m.p2 = M2 * R1 * R2;
    m.p3 = M2 * R2 * R2;
    m.p4 = m.p3 + J2;
    m.p5 = (M1 + M2) * R1 * GRAVITY;
    m.p6 = M2 * R2 * GRAVITY;
    return m;
}

static inline Terms terms(const Model *m, const double *q, const double *dq) {
    const double c2 = cos(q[1]), c12 = cos(q[0] + q[1]), h = m->p2 * sin(q[1]);
    Terms t;
    t.h11 = m->p1 + 2.0 * m->p2 * c2;
    t.h12 = m->p3 + m->p2 * c2;
    t.h22 = m->p4;
    t.bias1 = -h * (dq[0] + 2.0 * dq[1]) * dq[0] + m->p5 * cos(q[0]) + m->p6 * c12;
    t.bias2 = h * dq[1] * dq[1] + m->p6 * c12;
    return t;
}

static inline void acceleration(const Model *m, const double *q, const double *dq, const double *tau, double *ddq) {
    const Terms t = terms(m, q, dq);
    const double net1 = tau[0] + (0.5 * dq[0] + sin(3.0 * q[0]) + 0.5 * sin(dq[0])) - t.bias1;
    const double net2 = tau[1] + (1.3 * dq[1] - 1.8 * sin(2.0 * q[1]) + 1.1 * sin(dq[1])) - t.bias2;
    const double determinant = t.h11 * t.h22 - t.h12 * t.h12;
    ddq[0] = (t.h22 * net1 - t.h12 * net2) / determinant;
    ddq[1] = (t.h11 * net2 - t.h12 * net1) / determinant;
}

static inline void step(const Model *m, double *q, double *dq, const double *tau, double dt) {
    double k1[2], k2[2], k3[2], k4[2], sq[2], sdq[2];
    const double half = 0.5 * dt;
    int j;
    acceleration(m, q, dq, tau, k1);
    for (j = 0; j < 2; j++) {
        sq[j] = q[j] + half * dq[j];
        sdq[j] = dq[j] + half * k1[j];
    }
    acceleration(m, sq, sdq, tau, k2);
    for (j = 0; j < 2; j++) {
        sq[j] = q[j] + half * (dq[j] + half * k1[j]);
        sdq[j] = dq[j] + half * k2[j];
    }
    acceleration(m, sq, sdq, tau, k3);
    for (j = 0; j < 2; j++) {
        sq[j] = q[j] + dt * (dq[j] + half * k2[j]);
        sdq[j] = dq[j] + dt * k3[j];
    }
    acceleration(m, sq, sdq, tau, k4);
    for (j = 0; j < 2; j++) {
        q[j] += dt * (dq[j] + dt * (k1[j] + k2[j] + k3[j]) / 6.0);
        dq[j] += dt * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]) / 6.0;
    }
}

static inline double sign(double x) { return (x > 0.0) - (x < 0.0); }

static inline double clip(double x, double limit) { return fmin(fmax(x, -limit), limit); }

static void simulate(int samples, Result r) {
    const Model m = model_of();
    const double keep_dq = exp(-VELOCITY_CUTOFF * DT), keep_ddq = exp(-ACCELERATION_CUTOFF * DT);
    double q[JOINTS] = {0.0, -0.1}, dq[JOINTS] = {0.0, 0.0};
    Memory memory[JOINTS] = {{0}};
    int k, j;

    for (k = 0; k < samples; k++) {
        const double t = k * DT;
        double *desired = r.reference + 6 * k, *y = r.signals + SIGNALS * JOINTS * k, *tau = r.effort + 2 * k;
        double a_eq[JOINTS], a_cmd[JOINTS], hat[JOINTS], dhat[JOINTS];

        const double a0 = 0.2 * cos(0.7 * t), a1 = -0.2 * 0.7 * sin(0.7 * t), a2 = -0.7 * 0.7 * a0;
        const double b0 = 0.2 * cos(0.5 * t - 0.2), b1 = -0.2 * 0.5 * sin(0.5 * t - 0.2), b2 = -0.5 * 0.5 * b0;
        desired[0] = a0 + b0;
        desired[1] = b0 - a0;
        desired[2] = a1 + b1;
        desired[3] = b1 - a1;
        desired[4] = a2 + b2;
        desired[5] = b2 - a2;
        r.time[k] = t;
        memcpy(r.position + 2 * k, q, sizeof q);
        memcpy(r.velocity + 2 * k, dq, sizeof dq);

        for (j = 0; j < JOINTS; j++) {
            Memory *x = memory + j;
            double e, de, s, power, u_f, h, proportional_integral, sigma;
            if (k > 0) {
                const double was = x->dq;
                if (!x->saturated)
                    x->integral += DT * x->s;
                x->tau_sw += DT * (-K * x->tau_sw - (x->gain + XI) * sign(x->sigma));
                if (fabs(x->sigma) > UPSILON && !x->saturated)
                    x->gain += DT * fabs(x->sigma) / KAPPA;
                x->dq = keep_dq * x->dq + (1.0 - keep_dq) * (q[j] - x->q) / DT;
                x->ddq = keep_ddq * x->ddq + (1.0 - keep_ddq) * (x->dq - was) / DT;
            }
            x->q = q[j];
            e = q[j] - desired[j];
            de = x->dq - desired[2 + j];
            power = pow(fabs(e), ALPHA);
            s = de + K1 * (copysign(power, e) + e * e * e) + K2 * e;
            u_f = de == 0.0 ? 0.0 : e == 0.0 ? copysign(U_S, de) : clip(power / fabs(e) * de, U_S);
            h = K1 * (ALPHA * u_f + 3.0 * e * e * de) + K2 * de;
            proportional_integral = KP * s + KI * x->integral;
            sigma = proportional_integral + KD * (x->ddq - desired[4 + j] + h);
            a_eq[j] = desired[4 + j] + (-h - proportional_integral / KD);
            a_cmd[j] = desired[4 + j] + (-h - (proportional_integral - x->tau_sw) / KD);
            x->e = e;
            x->s = s;
            x->sigma = sigma;
            hat[j] = x->q;
            dhat[j] = x->dq;
            y[0 + j] = x->q;
            y[2 + j] = x->dq;
            y[4 + j] = x->ddq;
            y[6 + j] = e;
            y[8 + j] = de;
            y[10 + j] = s;
            y[12 + j] = sigma;
            y[14 + j] = x->gain;
            y[16 + j] = x->tau_sw;
            y[18 + j] = a_cmd[j];
        }
        {
            const Terms n = terms(&m, hat, dhat);
            y[20] = n.h11 * a_eq[0] + n.h12 * a_eq[1] + n.bias1;
            y[21] = n.h12 * a_eq[0] + n.h22 * a_eq[1] + n.bias2;
            tau[0] = n.h11 * a_cmd[0] + n.h12 * a_cmd[1] + n.bias1;
            tau[1] = n.h12 * a_cmd[0] + n.h22 * a_cmd[1] + n.bias2;
        }
        for (j = 0; j < JOINTS; j++) {
            memory[j].saturated = fabs(tau[j]) >= LIMIT[j];
            tau[j] = clip(tau[j], LIMIT[j]);
            y[22 + j] = tau[j];
            y[24 + j] = memory[j].saturated;
        }
        step(&m, q, dq, tau, DT);
    }
}

static double *numbers(size_t count) {
    double *array = malloc(count * sizeof *array);
    if (!array)
        abort();
    return array;
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

int main(int argc, char **argv) {
    const int samples = argc > 1 ? atoi(argv[1]) : 30000, repetitions = argc > 2 ? atoi(argv[2]) : 1;
    double rmse[JOINTS] = {0.0, 0.0};
    int i, j, k;
    for (i = 0; i < repetitions; i++) {
        const double begin = now();
        const size_t n = samples;
        Result r = {numbers(n), numbers(2 * n), numbers(2 * n), numbers(2 * n), numbers(6 * n),
                    numbers(n * SIGNALS * JOINTS)};
        simulate(samples, r);
        printf("%.9f\n", now() - begin);
        for (j = 0; j < JOINTS; j++) {
            double sum = 0.0;
            for (k = 0; k < samples; k++) {
                const double e = r.position[2 * k + j] - r.reference[6 * k + j];
                sum += e * e;
            }
            rmse[j] = sqrt(sum / samples);
        }
        free(r.time), free(r.position), free(r.velocity), free(r.effort), free(r.reference), free(r.signals);
    }
    printf("%.17g %.17g\n", rmse[0], rmse[1]);
    return 0;
}
