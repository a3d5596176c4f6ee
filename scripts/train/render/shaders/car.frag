// Materials as in cars.mesh.MATERIALS: 0 paint, 1 glass, 2 tyre, 3 rim, 4 headlamp, 5 taillamp, 6 chrome, 7 plastic,
// 8 plate, 9 underbody, 10 interior, 11 gap, 12 livery, 13 indicator.
uniform vec4 surface[14];  // linear RGB albedo, gloss (strength of the clear coat)
uniform vec4 mirror[14];   // F0 RGB of the metal under the coat, blur of its mirror image
uniform vec4 dirt;         // colour, amount
uniform vec4 glass;        // transmittance, strength of the mirror image, seed of the noise, unused
uniform vec2 lamps;        // light of head and tail lamps
uniform int own;   // index of this car

in vec3 position;
in vec3 position_in_car;
in vec3 normal;
flat in int material;
out vec4 colour;

void main() {
    vec3 view = normalize(camera_position - position);
    vec3 n = normalize(normal);
    bool inner = !gl_FrontFacing && material != 1;
    if (dot(n, view) < 0.0) n = material == 1 || inner ? -n : normalize(n - 1.02 * dot(n, view) * view);
    float open = open_sky(position, own);
    float low = smoothstep(0.0, 0.9, position_in_car.z);
    float occlusion = open * mix(1.0, mix(0.3, 1.0, low), 1.0 - max(n.z, 0.0));
    float light = lit(position, n);
    float facing = max(dot(n, to_sun), 0.0);
    vec3 ambient = mix(ground_radiance * mix(0.15, 0.9, low), sky, 0.5 + 0.5 * n.z) * occlusion;
    vec3 irradiance = sun * facing * light + ambient;

    if (inner || material == 10) {
        float shade = inner ? 0.5 : 1.0;
        colour = vec4(developed(surface[10].rgb * shade * (ambient * 0.4 + sun * facing * light * (inner ? 0.0 : 0.6)), position), 1.0);
        return;
    }
    vec3 back = reflect(-view, n);
    float grazing = pow(1.0 - clamp(dot(n, view), 0.0, 1.0), 5.0);
    float seen = back.z < 0.0 ? mix(0.12, 1.0, smoothstep(0.1, 1.6, position_in_car.z)) : open;
    float to_mirror = max(dot(back, to_sun), 0.0);

    if (material == 1) {
        float fresnel = (0.09 + 0.91 * grazing) * glass.y;  // both sides of the pane
        vec3 radiance = mirrored(back, 0.5) * fresnel * seen + irradiance * 0.012
            + sun * light * sun_mirror * fresnel * pow(to_mirror, 1500.0);
        radiance += dirt.rgb * dirt.a * 0.12 * irradiance;
        float through = glass.x * (1.0 - grazing) * max(1.0 - 0.3 * dirt.a, 0.2);
        float cover = 1.0 - pow(through, 0.45);  // blended after gamma
        colour = vec4(developed_pane(radiance, position, cover), cover);
        return;
    }
    vec4 s = surface[material];
    vec4 m = mirror[material];
    vec2 q = position_in_car.xz * 0.55 + position_in_car.y * vec2(0.31, 0.17) + glass.z;
    float grime = texture(noise, q).r;
    float soiled = clamp(dirt.a * (mix(1.6, 0.35, low) + 0.3 * max(n.z, 0.0)) * smoothstep(0.3, 0.75, grime), 0.0, 0.9);
    vec3 albedo = mix(s.rgb, dirt.rgb, soiled);
    float coat = s.a * (1.0 - soiled);
    float fresnel = (0.055 + 0.945 * grazing) * coat;
    vec3 radiance = albedo * irradiance * (1.0 - 0.8 * max(m.r, max(m.g, m.b)));
    radiance += m.rgb * (1.0 - soiled) * mirrored(back, m.a) * mix(0.35, 1.0, seen) * mix(occlusion, 1.0, 0.4);
    radiance += m.rgb * (1.0 - soiled) * sun * light * 0.9 * pow(to_mirror, 10.0);
    radiance += fresnel * (mirrored(back, 0.7) * seen + sun * light * sun_mirror * pow(to_mirror, 900.0));
    if (material == 4) radiance += vec3(1.0, 0.95, 0.85) * lamps.x * pow(max(dot(n, view), 0.0), 2.0);
    if (material == 5) radiance += vec3(1.0, 0.05, 0.03) * lamps.y;
    colour = vec4(developed(radiance, position), 1.0);
}
