in vec3 position;
in vec3 place;
in vec3 normal;
in vec4 base;
in float leaves;
out vec4 colour;

void main() {
    vec2 q = place.xy * vec2(0.41, 0.53) + place.z * vec2(0.37, 0.29);
    float grain = texture(noise, q).g, cloud = texture(noise, q * 0.6).r;
    if (leaves > 0.0 && grain + 0.6 * cloud < 0.8 * leaves + 0.15) discard;
    vec3 n = normalize(normal);
    if (leaves > 0.0) n = normalize(n + 1.6 * (vec3(grain, cloud, texture(noise, q.yx).g) - 0.5));
    float light = lit(position, n) * (leaves > 0.0 ? 0.5 + 0.5 * cloud : 1.0);
    float low = smoothstep(0.0, 0.8, position.z);
    vec3 ambient = mix(ground_radiance, sky, 0.5 + 0.5 * n.z) * mix(0.45, 1.0, low);
    vec3 albedo = base.rgb * (1.0 + base.a * 2.0 * (0.5 * grain + 0.5 * cloud - 0.5));
    if (leaves > 0.0) albedo *= 0.35 + 1.3 * grain * grain * 1.6;
    colour = vec4(developed(albedo * (sun * max(dot(n, to_sun), 0.0) * light + ambient), position), 1.0);
}
