"""The compute shaders of `gl_cost`.

Of the matching, a pixel with all its pairs' runs of labels (`runs`) is one invocation's. Its costs
at up to `LABELS` labels are its own column of shared memory, since so many have no room in
registers: each view is read once whatever the labels. As in `row_costs`, costs are kept as what
they differ from the same pair's cost at label 0; the sum of the latter is one more plane, after
the labels'. Series and sums are those of the numba form, not GL's own functions, whose precision
GL leaves open.
"""

GROUP = (16, 4)  # pixels of a work group of MATCH, across and down
LABELS = 96      # labels of a work group: 24 KiB of shared memory, of the 32 that GL promises
LINE = 64        # pixels of a row in a work group of the others

MATCH = f"""
#version 430
layout(local_size_x = {GROUP[0]}, local_size_y = {GROUP[1]}) in;
const int LANES = {GROUP[0] * GROUP[1]};
const int MOST = {LABELS};
""" + """
struct Pair { vec4 weights; vec4 limits; ivec4 inside; };  // colour, x, y; columns, rows
struct Node { vec4 across; vec4 down; ivec4 cell; };
struct Channels { vec3 colour; vec2 gradient; };
struct Quadratics { vec3 c0; vec3 c1; vec3 c2; vec2 g0; vec2 g1; vec2 g2; };
layout(std430, binding = 0) readonly buffer Planes { float planes[]; };  // view, y, channel, x
layout(std430, binding = 1) writeonly buffer Costs { float costs[]; };   // labels + 1, row, column
layout(std430, binding = 2) readonly buffer Runs { ivec4 runs[]; };      // pair, labels, node
layout(std430, binding = 3) readonly buffer Nodes { Node nodes[]; };
layout(std430, binding = 4) readonly buffer Times { float times[]; };    // pair, label
layout(std430, binding = 5) readonly buffer Pairs { Pair pairs[]; };
uniform ivec3 size;     // columns, rows, labels
uniform ivec3 lattice;  // left, top [px of a plane], stride
uniform ivec2 plane;    // columns, rows of a view's channel [px]
uniform bool l2;
shared float totals[MOST][LANES];

// Weights of differences: what is the same everywhere is then read exactly.
float mixed(vec4 v, vec4 taps) {
    return v.y + (taps.x * (v.x - v.y) + taps.z * (v.z - v.y) + taps.w * (v.w - v.y));
}

float read(int at, Node node) {
    vec4 between;
    int line = 5 * plane.x;
    for (int k = 0; k < 4; ++k) {
        int i = at + k - 1;
        between[k] = mixed(vec4(planes[i - line], planes[i], planes[i + line],
                                planes[i + 2 * line]), node.down);
    }
    return mixed(between, node.across);
}

Channels seen(int view, ivec2 pixel, Node node) {
    ivec2 cell = pixel + node.cell.xy;
    int at = 5 * (view * plane.y + cell.y) * plane.x + cell.x;
    return Channels(vec3(read(at, node), read(at + plane.x, node), read(at + 2 * plane.x, node)),
                    vec2(read(at + 3 * plane.x, node), read(at + 4 * plane.x, node)));
}

Channels pixel_of_centre(ivec2 pixel) {
    int at = 5 * pixel.y * plane.x + pixel.x;
    return Channels(vec3(planes[at], planes[at + plane.x], planes[at + 2 * plane.x]),
                    vec2(planes[at + 3 * plane.x], planes[at + 4 * plane.x]));
}

float cost(Quadratics q, float t, vec4 limits) {
    vec3 colour = abs(q.c0 + t * (q.c1 + t * q.c2));
    vec2 gradient = min(abs(q.g0 + t * (q.g1 + t * q.g2)), limits.yz);
    float apart = l2 ? sqrt(dot(colour, colour)) : colour.x + colour.y + colour.z;
    return min(apart, limits.x) + (gradient.x + gradient.y);
}

void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(at, size.xy))) return;
    int lane = int(gl_LocalInvocationIndex);
    int begin = int(gl_WorkGroupID.z) * MOST;
    int end = min(begin + MOST, size.z);
    for (int label = begin; label < end; ++label) totals[label - begin][lane] = 0.0;
    ivec2 pixel = lattice.xy + lattice.z * at;
    Channels centre = pixel_of_centre(pixel);
    int kept = -1;  // the node that `last` is of
    Channels last;
    float base = 0.0, summed = 0.0;  // a pair's cost at label 0, the sum of these
    for (int run = 0; run < runs.length(); ++run) {
        ivec4 where = runs[run];
        int from = max(where.y, begin), to = min(where.z, end);
        Pair pair = pairs[where.x];
        if ((from >= to && where.y > 0) || any(lessThan(at, pair.inside.xz))
            || any(greaterThanEqual(at, pair.inside.yw))) continue;
        Channels first = last;
        if (kept != where.w) first = seen(where.x + 1, pixel, nodes[where.w]);
        Channels middle = seen(where.x + 1, pixel, nodes[where.w + 1]);
        last = seen(where.x + 1, pixel, nodes[where.w + 2]);
        kept = where.w + 2;
        vec3 half_way = middle.colour - first.colour, way = last.colour - first.colour;
        vec2 half_turn = middle.gradient - first.gradient, turn = last.gradient - first.gradient;
        vec3 colour = pair.weights.x * (first.colour - centre.colour);
        vec2 gradient = pair.weights.yz * (first.gradient - centre.gradient);
        Quadratics q = Quadratics(
            colour, pair.weights.x * (4.0 * half_way - way),
            pair.weights.x * 2.0 * (way - 2.0 * half_way),
            gradient, pair.weights.yz * (4.0 * half_turn - turn),
            pair.weights.yz * 2.0 * (turn - 2.0 * half_turn));
        int now = where.x * size.z;
        if (where.y == 0) {
            base = cost(q, times[now], pair.limits);
            summed += base;
        }
        for (int label = from; label < to; ++label)
            totals[label - begin][lane] += cost(q, times[now + label], pair.limits) - base;
    }
    int area = size.x * size.y, here = at.y * size.x + at.x;
    for (int label = begin; label < end; ++label)
        costs[label * area + here] = totals[label - begin][lane];
    if (begin == 0) costs[size.z * area + here] = summed;
}
"""

SUM = f"""
#version 430
layout(local_size_x = {LINE}) in;
""" + """
layout(std430, binding = 0) readonly buffer Source { float source[]; };  // label, row, column
layout(std430, binding = 1) writeonly buffer Sums { float sums[]; };
uniform ivec3 size;  // columns, rows, labels
uniform int reach;   // pixels each side; none lie outside the image
uniform bool down;   // over rows; else over columns

void main() {
    int x = int(gl_GlobalInvocationID.x);
    int y = int(gl_WorkGroupID.y);
    int plane = int(gl_WorkGroupID.z) * size.x * size.y;
    if (x >= size.x) return;
    int place = down ? y : x, end = down ? size.y : size.x, step = down ? size.x : 1;
    int here = plane + y * size.x + x;
    float sum = 0.0;
    for (int k = max(-reach, -place); k <= min(reach, end - 1 - place); ++k)
        sum += source[here + k * step];
    sums[here] = sum;
}
"""

LIKELIHOOD = f"""
#version 430
layout(local_size_x = {LINE}) in;
""" + """
layout(std430, binding = 0) readonly buffer Costs { float costs[]; };  // labels + 1, row, column
layout(std430, binding = 1) writeonly buffer Likelihood { float likelihood[]; };  // y, x, label
uniform ivec3 size;    // columns, rows, labels
uniform ivec4 wanted;  // first column and row in these; columns, rows

float log1p(float x) {  // of x in [0, 1]: 2 artanh(x / (2 + x))
    float s = x / (2.0 + x), q = s * s, series = 1.0 / 13.0;
    for (int n = 11; n >= 1; n -= 2) series = series * q + 1.0 / float(n);
    return (s + s) * series;
}

void main() {
    int x = int(gl_GlobalInvocationID.x);
    int y = int(gl_WorkGroupID.y);
    if (x >= wanted.z) return;
    int here = (wanted.y + y) * size.x + wanted.x + x;
    int area = size.x * size.y;
    float most = costs[here], total = 0.0;
    for (int label = 0; label < size.z; ++label) {
        float cost = costs[label * area + here];
        most = max(most, cost);
        total += cost;
    }
    total += float(size.z) * costs[size.z * area + here];
    float share = total > 1e-30 ? 1.0 / total : 0.0;
    for (int label = 0; label < size.z; ++label) {
        float cost = costs[label * area + here];
        likelihood[(y * wanted.z + x) * size.z + label] = log1p((most - cost) * share);
    }
}
"""
