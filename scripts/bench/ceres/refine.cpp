// The joint refinement of crates/solve as a Ceres problem with automatic derivatives. There is one residual block per
// keypoint and one parameter block per car, so the Schur complement is the camera's 4 × 4. It reads the files of the
// example `refinement_problems`, which documents their format. Per problem it prints the CPU time of the fastest linear
// solver, and the final cost.
#include <ceres/ceres.h>
#include <glog/logging.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <deque>
#include <fstream>
#include <iostream>
#include <limits>
#include <string>
#include <vector>

namespace {

constexpr int kPoints = 36, kModes = 6;
constexpr double kNever = std::numeric_limits<double>::infinity();
using Point = std::array<double, 3>;

struct Atlas {
  std::array<Point, kPoints> mean;
  std::array<std::array<Point, kPoints>, kModes> modes;
};

struct Keypoint {
  int index;
  double x, y, sd, weight;
};

struct Car {
  std::array<double, 3 + kModes> state;  // anchor u, v, heading, shape
  std::vector<Keypoint> keypoints;
};

struct Scene {
  double threshold_squared;
  std::array<double, 4> prior_mean, prior_information, camera;  // log f, tilt, roll, log h
  std::vector<Car> cars;
};

// Equations of crates/solve/src/ground_residual.rs.
struct Reprojection {
  const Atlas& atlas;
  Keypoint keypoint;

  template <typename T>
  bool operator()(const T* camera, const T* car, T* residual) const {
    using std::cos, std::exp, std::sin;
    const T focal = exp(camera[0]), height = exp(camera[3]);
    const T st = sin(camera[1]), ct = cos(camera[1]), sr = sin(camera[2]), cr = cos(camera[2]);
    const T right[3] = {cr, sr, T(0)};
    const T forward[3] = {sr * st, -cr * st, ct};
    const T up[3] = {sr * ct, -cr * ct, -st};
    const T ray[3] = {car[0] / focal, car[1] / focal, T(1)};
    const T fall = -(up[0] * ray[0] + up[1] * ray[1] + up[2] * ray[2]);
    if (fall <= T(1e-6)) return false;
    const T depth = height / fall;
    T point[3];
    for (int k = 0; k < 3; ++k) {
      point[k] = T(atlas.mean[keypoint.index][k]);
      for (int j = 0; j < kModes; ++j) point[k] += atlas.modes[j][keypoint.index][k] * car[3 + j];
    }
    const T ch = cos(car[2]), sh = sin(car[2]);
    const T x = ch * point[0] - sh * point[1], y = sh * point[0] + ch * point[1];
    T p[3];
    for (int k = 0; k < 3; ++k) p[k] = ray[k] * depth + right[k] * x + forward[k] * y + up[k] * point[2];
    if (p[2] <= T(0.1)) return false;
    residual[0] = (focal * p[0] / p[2] - keypoint.x) / keypoint.sd;
    residual[1] = (focal * p[1] / p[2] - keypoint.y) / keypoint.sd;
    return true;
  }
};

struct ShapePrior {
  template <typename T>
  bool operator()(const T* car, T* residual) const {
    for (int j = 0; j < kModes; ++j) residual[j] = car[3 + j];
    return true;
  }
};

struct CameraPrior {
  const Scene& scene;
  template <typename T>
  bool operator()(const T* camera, T* residual) const {
    for (int j = 0; j < 4; ++j) {
      residual[j] = (camera[j] - scene.prior_mean[j]) * std::sqrt(scene.prior_information[j]);
    }
    return true;
  }
};

// The mixture of crates/solve/src/kernel.rs.
class Mixture : public ceres::LossFunction {
 public:
  explicit Mixture(double threshold_squared)
      : t_(threshold_squared), at_zero_(2 * std::log1p(std::exp(-threshold_squared / 2))) {}
  void Evaluate(double s, double out[3]) const override {
    const double gap = (s - t_) / 2, ratio = std::exp(-std::abs(gap));
    const double right = gap < 0 ? 1 / (1 + ratio) : ratio / (1 + ratio);
    out[0] = std::min(s, t_) - 2 * std::log1p(ratio) + at_zero_;
    out[1] = right;
    out[2] = -0.5 * right * (1 - right);
  }

 private:
  double t_, at_zero_;
};

double CpuSeconds() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return t.tv_sec + 1e-9 * t.tv_nsec;
}

template <typename T>
void Read(std::istream& in, T& values) {
  for (auto& v : values) in >> v;
}

Atlas ReadAtlas(const std::string& path) {
  std::ifstream in(path);
  Atlas atlas;
  for (auto& p : atlas.mean) Read(in, p);
  for (auto& mode : atlas.modes)
    for (auto& p : mode) Read(in, p);
  CHECK(in) << path << " is not an atlas";
  return atlas;
}

Scene ReadScene(const std::string& path) {
  std::ifstream in(path);
  Scene scene;
  in >> scene.threshold_squared;
  Read(in, scene.prior_mean);
  Read(in, scene.prior_information);
  Read(in, scene.camera);
  size_t count;
  in >> count;
  scene.cars.resize(in ? count : 0);
  for (auto& car : scene.cars) {
    Read(in, car.state);
    in >> count;
    car.keypoints.resize(in ? count : 0);
    for (auto& k : car.keypoints) in >> k.index >> k.x >> k.y >> k.sd >> k.weight;
  }
  CHECK(in && !scene.cars.empty()) << path << " is not a problem";
  return scene;
}

struct Result {
  double seconds, with_building, cost;
  int iterations;
  std::string solver;
};

// Time of Solve() alone, and together with building the problem.
Result Refine(const Atlas& atlas, const Scene& start, ceres::LinearSolverType type) {
  Result best{kNever, kNever, 0, 0, ceres::LinearSolverTypeToString(type)};
  double spent = 0;
  for (int run = 0; run < 200 && (run < 3 || spent < 0.1); ++run) {
    Scene scene = start;
    const double building = CpuSeconds();
    ceres::Problem::Options ownership;
    ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ceres::Problem problem(ownership);
    Mixture mixture(scene.threshold_squared);
    std::deque<ceres::ScaledLoss> losses;
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    problem.AddParameterBlock(scene.camera.data(), 4);
    ordering->AddElementToGroup(scene.camera.data(), 1);
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<CameraPrior, 4, 4>(new CameraPrior{scene}), nullptr,
                             scene.camera.data());
    for (auto& car : scene.cars) {
      double* state = car.state.data();
      problem.AddParameterBlock(state, 3 + kModes);
      ordering->AddElementToGroup(state, 0);
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<ShapePrior, kModes, 3 + kModes>(new ShapePrior), nullptr,
                               state);
      for (const auto& keypoint : car.keypoints) {
        losses.emplace_back(&mixture, keypoint.weight, ceres::DO_NOT_TAKE_OWNERSHIP);
        problem.AddResidualBlock(
            new ceres::AutoDiffCostFunction<Reprojection, 2, 4, 3 + kModes>(new Reprojection{atlas, keypoint}),
            &losses.back(), scene.camera.data(), state);
      }
    }
    ceres::Solver::Options options;
    options.linear_solver_type = type;
    options.linear_solver_ordering = ordering;
    options.num_threads = 1;
    options.max_num_iterations = 100;
    options.function_tolerance = 1e-8;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    const double begin = CpuSeconds();
    ceres::Solve(options, &problem, &summary);
    const double end = CpuSeconds(), seconds = end - begin;
    spent += seconds;
    if (!summary.IsSolutionUsable()) continue;
    best.seconds = std::min(best.seconds, seconds);
    best.with_building = std::min(best.with_building, end - building);
    best.cost = summary.final_cost;
    best.iterations = static_cast<int>(summary.iterations.size());
  }
  return best;
}

}  // namespace

int main(int argc, char** argv) {
  google::InitGoogleLogging(argv[0]);
  CHECK(argc > 2) << "usage: refine ATLAS PROBLEM...";
  const Atlas atlas = ReadAtlas(argv[1]);
  std::cout << "name milliseconds with_building iterations cost solver\n";
  std::cout.precision(12);
  for (int i = 2; i < argc; ++i) {
    const Scene scene = ReadScene(argv[i]);
    Result best{kNever, kNever, 0, 0, ""};
    for (const auto type : {ceres::DENSE_SCHUR, ceres::SPARSE_SCHUR, ceres::ITERATIVE_SCHUR}) {
      const Result result = Refine(atlas, scene, type);
      if (result.seconds < best.seconds) best = result;
    }
    std::string name = argv[i];
    name = name.substr(name.find_last_of('/') + 1);
    std::cout << name.substr(0, name.find('.')) << ' ' << 1e3 * best.seconds << ' ' << 1e3 * best.with_building << ' '
              << best.iterations << ' ' << best.cost
              << ' ' << best.solver << '\n';
  }
}
