// OctoMap itself, without a binding: CPU time per cloud, memory, classes of a box.
//
//     mapping_octomap CLOUDS VOXEL ROUNDS DISCRETIZE LAZY CLASSES KX KY KZ NX NY NZ
//
// CLOUDS: per cloud int64 N, double[3] origin, float[3 N] points, native order. CLASSES: written, NX*NY*NZ
// bytes (0 unknown, 1 free, 2 occupied) of the box whose first voxel has key KX KY KZ (minus 32768).
#include <octomap/octomap.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <malloc.h>
#include <string>
#include <unistd.h>
#include <vector>

static double cpu_ms() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return t.tv_sec * 1e3 + t.tv_nsec * 1e-6;
}

static long kib(const std::string& key) {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;)
    if (word == key) {
      long value;
      status >> value;
      return value;
    }
  return 0;
}

int main(int argc, char** argv) {
  if (argc != 13) return 2;
  const double voxel = atof(argv[2]);
  const int rounds = atoi(argv[3]);
  const bool discretize = atoi(argv[4]), lazy = atoi(argv[5]);
  std::vector<octomap::Pointcloud> clouds;
  std::vector<octomap::point3d> origins;
  std::ifstream in(argv[1], std::ios::binary);
  for (int64_t n; in.read(reinterpret_cast<char*>(&n), 8);) {
    double o[3];
    in.read(reinterpret_cast<char*>(o), 24);
    std::vector<float> xyz(3 * n);
    in.read(reinterpret_cast<char*>(xyz.data()), 12 * n);
    octomap::Pointcloud cloud;
    cloud.reserve(n);
    for (int64_t i = 0; i < n; ++i) cloud.push_back(xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]);
    clouds.push_back(cloud);
    origins.emplace_back(o[0], o[1], o[2]);
  }
  octomap::OcTree tree(voxel);
  malloc_trim(0);
  std::ofstream("/proc/self/clear_refs") << "5";  // the peak starts from here.
  const long before = kib("VmRSS:");
  printf("{\"ms\": [");
  for (int r = 0; r < rounds; ++r) {
    printf(r ? ", [" : "[");
    for (size_t i = 0; i < clouds.size(); ++i) {
      const double began = cpu_ms();
      tree.insertPointCloud(clouds[i], origins[i], -1.0, lazy, discretize);
      printf(i ? ", %.3f" : "%.3f", cpu_ms() - began);
    }
    printf("]");
  }
  const long steady = kib("VmRSS:") - before, peak = kib("VmHWM:") - before;
  printf("], \"nodes_bytes\": %zu, \"steady_kib\": %ld, \"peak_kib\": %ld}\n", tree.memoryUsage(), steady, peak);
  long key[3], size[3];
  for (int a = 0; a < 3; ++a) key[a] = atol(argv[7 + a]), size[a] = atol(argv[10 + a]);
  std::vector<uint8_t> classes(size[0] * size[1] * size[2]);
  size_t at = 0;
  for (long i = 0; i < size[0]; ++i)
    for (long j = 0; j < size[1]; ++j)
      for (long k = 0; k < size[2]; ++k) {
        const octomap::OcTreeNode* node = tree.search(octomap::OcTreeKey(
            32768 + key[0] + i, 32768 + key[1] + j, 32768 + key[2] + k));
        classes[at++] = !node ? 0 : tree.isNodeOccupied(node) ? 2 : 1;
      }
  std::ofstream(argv[6], std::ios::binary)
      .write(reinterpret_cast<const char*>(classes.data()), classes.size());
}
