// The bank in C++ with Eigen's fixed-size matrices: what one would write by hand.
//
//   eigen CASE    CASE: record_NAME, lanes_NAME or simulate_NAME, NAME as in problems.py
//
// Reads a line, makes one pass, prints "items checksum", and so on until the input ends.
// Built by run.sh with -O3 -march=native.

#include <Eigen/Dense>
#include <cmath>
#include <cstdint>
#include <functional>
#include <iostream>
#include <random>
#include <string>
#include <vector>

constexpr int RECORDS = 1024, STEPS = 250, CHECKED_RECORDS = 4;
// Records that share a coefficient: as many as two 512-bit or four 256-bit registers hold.
constexpr int LANES = 16;

// Entry after entry of the stream of `state`, in [-1, 1); see problems.py.
struct Stream {
    std::uint64_t state;
    double next() {
        state += 0x9E3779B97F4A7C15u;
        std::uint64_t z = state;
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
        z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
        z ^= z >> 31;
        return std::ldexp(static_cast<double>(z >> 11), -53) * 2.0 - 1.0;
    }
};

template <int n, int q>
struct Model {
    Eigen::Matrix<double, n, n> a;
    Eigen::Matrix<double, q, n> c;
    Eigen::Matrix<double, n, q> k;
    Eigen::Matrix<double, q, q> w; // w' w = S^-1
    double norm;

    // The steady filter, from the recursion of the covariance.
    void design() {
        using P = Eigen::Matrix<double, n, n>;
        using S = Eigen::Matrix<double, q, q>;
        P p = P::Identity();
        S s;
        for (int i = 0; i < 5000; ++i) {
            s = c * p * c.transpose() + S::Identity();
            k = p * c.transpose() * s.inverse();
            P next = a * (p - k * c * p) * a.transpose() + P::Identity();
            p = 0.5 * (next + next.transpose());
        }
        s = c * p * c.transpose() + S::Identity();
        k = p * c.transpose() * s.inverse();
        w = S(s.llt().matrixL()).inverse();
        norm = -0.5 * (std::log(s.determinant()) + q * std::log(2.0 * M_PI));
    }
};

template <int n, int q, int N>
struct Bank {
    std::vector<Model<n, q>> models{N};
    std::vector<double> y; // record, step, output
    std::vector<double> log_lik; // record, model

    Bank() : log_lik(static_cast<std::size_t>(RECORDS) * N) {
        Stream stream{400 + n};
        const double root = 1.5 * std::sqrt(static_cast<double>(n));
        for (auto &m : models) {
            for (int i = 0; i < n; ++i)
                for (int j = 0; j < n; ++j) m.a(i, j) = stream.next() / root;
            for (int i = 0; i < q; ++i)
                for (int j = 0; j < n; ++j) m.c(i, j) = stream.next();
            m.design();
        }
        y.resize(static_cast<std::size_t>(RECORDS) * STEPS * q);
        for (auto &v : y) v = 3.0 * stream.next();
    }

    // Mean log-likelihood a step of the first records, and the posterior at the end.
    double finish() {
        double sum = 0.0;
        for (int r = 0; r < RECORDS; ++r) {
            Eigen::Map<Eigen::Array<double, N, 1>> l(&log_lik[static_cast<std::size_t>(r) * N]);
            for (int m = 0; m < N; ++m) l(m) += STEPS * models[m].norm;
            if (r < CHECKED_RECORDS) sum += l.sum();
            Eigen::Array<double, N, 1> p = (l - l.maxCoeff()).exp();
            p /= p.sum();
            l = p;
        }
        return sum / (static_cast<double>(CHECKED_RECORDS) * N * STEPS);
    }

    // A filter a record and model, its state in registers.
    double by_record() {
        for (int r = 0; r < RECORDS; ++r)
            for (int m = 0; m < N; ++m) {
                const Model<n, q> model = models[m];
                Eigen::Matrix<double, n, 1> x = Eigen::Matrix<double, n, 1>::Zero();
                double l = 0.0;
                const double *seen = &y[static_cast<std::size_t>(r) * STEPS * q];
                for (int t = 0; t < STEPS; ++t, seen += q) {
                    const Eigen::Matrix<double, q, 1> e =
                        Eigen::Map<const Eigen::Matrix<double, q, 1>>(seen) - model.c * x;
                    l -= 0.5 * (model.w * e).squaredNorm();
                    const Eigen::Matrix<double, n, 1> there = x + model.k * e;
                    x.noalias() = model.a * there;
                }
                log_lik[static_cast<std::size_t>(r) * N + m] = l;
            }
        return finish();
    }

    // Records in lanes: every coefficient serves a packet of them, models inside time.
    double by_lanes() {
        using Lane = Eigen::Array<double, LANES, 1>;
        std::vector<Lane> seen(static_cast<std::size_t>(STEPS) * q);
        for (int first = 0; first < RECORDS; first += LANES) {
            for (int t = 0; t < STEPS * q; ++t)
                for (int r = 0; r < LANES; ++r)
                    seen[t](r) = y[static_cast<std::size_t>(first + r) * STEPS * q + t];
            for (int m = 0; m < N; ++m) {
                const Model<n, q> &model = models[m];
                const Eigen::Matrix<double, n, q> ak = model.a * model.k;
                Lane x[n], l = Lane::Zero();
                for (auto &v : x) v.setZero();
                for (int t = 0; t < STEPS; ++t) {
                    Lane e[q], next[n];
                    for (int i = 0; i < q; ++i) {
                        e[i] = seen[t * q + i];
                        for (int j = 0; j < n; ++j) e[i] -= model.c(i, j) * x[j];
                    }
                    for (int i = 0; i < q; ++i) {
                        Lane white = model.w(i, 0) * e[0];
                        for (int j = 1; j <= i; ++j) white += model.w(i, j) * e[j];
                        l -= 0.5 * white * white;
                    }
                    for (int i = 0; i < n; ++i) {
                        next[i] = model.a(i, 0) * x[0];
                        for (int j = 1; j < n; ++j) next[i] += model.a(i, j) * x[j];
                        for (int j = 0; j < q; ++j) next[i] += ak(i, j) * e[j];
                    }
                    for (int i = 0; i < n; ++i) x[i] = next[i];
                }
                for (int r = 0; r < LANES; ++r)
                    log_lik[static_cast<std::size_t>(first + r) * N + m] = l(r);
            }
        }
        return finish();
    }

    // Noise, truth, bank, weights and squared error of the fused estimate, trial by trial.
    double simulate() {
        using X = Eigen::Matrix<double, n, 1>;
        using Y = Eigen::Matrix<double, q, 1>;
        double nis = 0.0, error = 0.0;
        for (int r = 0; r < RECORDS; ++r) {
            std::mt19937_64 words(static_cast<std::uint64_t>(r) + 1);
            std::normal_distribution<double> normal;
            X x = X::Zero();
            X xhat[N];
            double l[N] = {}, last = 0.0;
            for (auto &v : xhat) v.setZero();
            for (int t = 0; t < STEPS; ++t) {
                X w;
                Y v;
                for (int i = 0; i < n; ++i) w(i) = normal(words);
                for (int i = 0; i < q; ++i) v(i) = normal(words);
                x = models[0].a * x + w;
                const Y seen = models[0].c * x + v;
                for (int m = 0; m < N; ++m) {
                    const X ahead = models[m].a * xhat[m];
                    const Y e = seen - models[m].c * ahead;
                    const double square = (models[m].w * e).squaredNorm();
                    if (m == 0) last = square;
                    l[m] -= 0.5 * square;
                    xhat[m] = ahead + models[m].k * e;
                }
            }
            nis += last;
            double top = -INFINITY, sum = 0.0;
            for (int m = 0; m < N; ++m) top = std::max(top, l[m] += STEPS * models[m].norm);
            X fused = X::Zero();
            for (int m = 0; m < N; ++m) {
                const double p = std::exp(l[m] - top);
                sum += p;
                fused += p * xhat[m];
            }
            error += (x - fused / sum).squaredNorm();
        }
        // read, so that it is computed
        return nis / (RECORDS * q) + 0.0 * error;
    }
};

template <int n, int q, int N>
int serve(const std::string &kind) {
    Bank<n, q, N> bank;
    std::function<double()> pass;
    if (kind == "record") pass = [&] { return bank.by_record(); };
    if (kind == "lanes") pass = [&] { return bank.by_lanes(); };
    if (kind == "simulate") pass = [&] { return bank.simulate(); };
    if (!pass) return 2;
    for (std::string line; std::getline(std::cin, line);) {
        const double checksum = pass();
        std::cout.precision(17);
        std::cout << static_cast<double>(RECORDS) * STEPS * N << ' ' << checksum << std::endl;
    }
    return 0;
}

int main(int count, char **arguments) {
    const std::string name = count > 1 ? arguments[1] : "";
    const auto at = name.find('_');
    const std::string kind = name.substr(0, at), bank = at == name.npos ? "" : name.substr(at + 1);
    if (bank == "n3_q1_N4") return serve<3, 1, 4>(kind);
    if (bank == "n4_q2_N16") return serve<4, 2, 16>(kind);
    std::cerr << "usage: eigen {record,lanes,simulate}_{n3_q1_N4,n4_q2_N16}\n";
    return 2;
}
