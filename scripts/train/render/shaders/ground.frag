// Two ground materials with a kerb between them, and painted lines on the first.
uniform vec3 low[2];
uniform vec3 high[2];
uniform vec4 scales[2];   // noise over tens of metres, metres, centimetres; stains
uniform vec2 surface[2];  // cracks, wetness
uniform vec4 borders[3];  // second material where n.p > d: n, d, kerb's width; n = 0 for none
uniform float kerb_width;
uniform vec4 frame;       // origin and direction of the lines' frame
uniform vec4 bays;        // kind (0 none, 1 bays, 2 lanes), pitch, length, line width
uniform vec3 rows;        // distance of the next row (0 none), head line: offset, strength
uniform vec4 paint;       // linear RGB, wear
uniform vec2 seed;

in vec3 position;
out vec4 colour;

float band(float x, float half_width, float pixel) {
    return clamp((half_width - abs(x)) / pixel + 0.5, 0.0, 1.0) * min(1.0, 2.0 * half_width / pixel);
}

float lines(vec2 p, float pixel) {
    vec2 q = vec2(dot(p - frame.xy, frame.zw), dot(p - frame.xy, vec2(-frame.w, frame.z)));
    float half_width = bays.w * 0.5;
    if (bays.x < 1.5) {
        if (rows.x > 0.0) q.y = mod(q.y + 0.5 * rows.x, rows.x) - 0.5 * rows.x;
        float across = abs(mod(q.x, bays.y) - 0.5 * bays.y) - 0.5 * bays.y;
        float inside = clamp((bays.z - abs(q.y)) / pixel + 0.5, 0.0, 1.0);
        float ends = rows.z * band(q.y - rows.y, half_width, pixel);
        return max(band(across, half_width, pixel) * inside, ends);
    }
    float across = abs(mod(q.x, bays.y) - 0.5 * bays.y) - 0.5 * bays.y;
    float solid = step(1.5, abs(floor(q.x / bays.y + 0.5)));
    float dash = max(solid, step(mod(q.y, bays.z), bays.z * 0.4));
    return abs(q.x) < bays.y * 2.5 ? band(across, half_width, pixel) * dash : 0.0;
}

void main() {
    vec2 p = position.xy;
    vec2 at = p + seed;
    float pixel = max(length(fwidth(p)) * 0.7, 1e-3);
    float other = 0.0, kerb = 0.0, shade = 1.0;
    for (int i = 0; i < 3; i++) {
        if (dot(borders[i].xy, borders[i].xy) < 0.5) continue;
        float past = dot(p, borders[i].xy) - borders[i].z;
        other = max(other, clamp(past / pixel + 0.5, 0.0, 1.0));
        kerb = max(kerb, band(past, kerb_width, pixel));
        shade = min(shade, 1.0 - 0.45 * band(past + kerb_width, 0.06, pixel));
    }
    int kind = other > 0.5 ? 1 : 0;
    float n1 = texture(noise, at / 41.0).r, n2 = texture(noise, at / 7.3 + 0.37).r, n3 = texture(noise, at / 1.9).g;
    float finest = exp2(floor(log2(pixel))) * 230.0;  // grain of about two pixels whatever the distance
    n3 = 0.5 * n3 + 0.5 * texture(noise, at / finest).g;
    vec4 s = scales[kind];
    float mixed = clamp(0.5 + (n1 - 0.5) * s.x + (n2 - 0.5) * s.y + (n3 - 0.5) * s.z * 0.7, 0.0, 1.0);
    vec3 albedo = mix(low[kind], high[kind], mixed) * (1.0 + (n3 - 0.5) * s.z * 0.8);
    float stain = smoothstep(0.55, 0.95, texture(noise, at / 5.1 + 0.71).a) * s.w;
    float crack = texture(noise, at / 9.0 + 0.13).b * surface[kind].x;
    albedo *= (1.0 - 0.55 * stain) * (1.0 - 0.6 * crack);
    if (kind == 0 && bays.x > 0.5) {
        float worn = smoothstep(paint.a - 0.3, paint.a + 0.3, 0.35 + 0.65 * n3 * (0.6 + n2));
        albedo = mix(albedo, paint.rgb, lines(p, pixel) * worn);
    }
    albedo = mix(albedo, vec3(0.33, 0.32, 0.30) * (0.8 + 0.4 * n3), kerb) * shade;

    vec3 view = normalize(camera_position - position);
    float open = open_sky(position, -1);
    float light = lit(position, vec3(0, 0, 1));
    vec3 radiance = albedo * (sun * max(to_sun.z, 0.0) * light + sky * open);
    float wet = surface[kind].y * smoothstep(0.35, 0.65, n1 * 0.6 + n2 * 0.4) * (1.0 - kerb);
    if (wet > 0.01) {
        vec3 n = normalize(vec3((n3 - 0.5) * 0.05, (n2 - 0.5) * 0.05, 1.0));
        float fresnel = 0.03 + 0.97 * pow(1.0 - max(dot(n, view), 0.0), 5.0);
        radiance = radiance * (1.0 - 0.45 * wet) + wet * fresnel * open * mirrored(reflect(-view, n), 1.5);
    }
    colour = vec4(developed(radiance, position), 1.0);
}
