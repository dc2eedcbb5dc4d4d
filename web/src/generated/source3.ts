// Written by `cargo xtask web`; changes are lost.

export const text = "fn T9b(Tz:u32,T4:vec2<f32>,T1:u32)->vec4<f32>{let T4n=(Tz==1u)&(T2.Tek==1u);let T5=T9(select(T2.Tjk,T2.Tjl,T4n),T1);let at=T4*(1.0/f32(i32(1u<<T1)))-vec2<f32>(0.5);let Tn=floor(at);let Tp=T1h(vec2<i32>(Tn),T5);let T16=T3z(Tp,T1h(vec2<i32>(Tn)+vec2<i32>(1),T5),at-Tn);var a=vec4<f32>(0.0);if!T4n{a=T30(T7q,T16,T1);}var b=a;if T4n|(T2.T3j==T3k){b=T30(Tcu,T16,T1);}return T1p(select(a,b,T4n),b,T2.T3j);}\n";
